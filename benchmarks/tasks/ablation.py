"""What each arm of the race is worth: the same task once more without it.

Only an arm that had a part in the policy is left out, unless arms are named: one from whose
policies it was begun, or that found it. Without another one the race has the same parts, and some
more time for them. Where the last part of a race is the polishing that is left out, the race ends
there.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.common.auto_variants import VARIANTS, without
from benchmarks.common.markdown import table_row
from benchmarks.common.records import Records
from benchmarks.tasks.names import NOISE, WHOLE, WITHOUT_NOISE
from benchmarks.tasks.paired import paired
from benchmarks.tasks.trial import COLUMNS, KEYS, Conditions, Task, run_tasks
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.mdpo import MDPO
from mdpo_rddl.planner.config.search_section import OPTIONAL_ARMS
from mdpo_rddl.race.arms.gradients import FEEDBACK as GRADIENT


def make_variant(name: str) -> MDPO:
    """The race, changed.

    Args:
      name: a key of `VARIANTS`.
    """
    return MDPO(VARIANTS[name])


def run_ablation(
    out: Path,
    tasks: Sequence[Task],
    seeds: int,
    conditions: Conditions,
    shard: tuple[int, int] = (0, 1),
    arms: Sequence[str] = (),
) -> Records:
    """Runs the whole race on each task, then without each arm that had a part in its policies.

    Where the gradient had one, it runs without its noise, too. Rows that are there already are
    skipped.

    Args:
      out: results folder.
      tasks: in the order in which they are tried.
      seeds: of the preparation, from 0; an arm is left out with all of them.
      conditions: of all trials.
      shard: (i, n): only every n-th task, from the i-th on.
      arms: are left out in place of those that had a part, whether they had one or not.

    Raises:
      InputError: for an arm that there is not.
    """
    if unknown := sorted({*arms} - {*OPTIONAL_ARMS}):
        raise InputError(f"{unknown[0]!r} is none of the arms {', '.join(OPTIONAL_ARMS)}")
    number, count = shard
    for task in tasks[number::count]:
        whole = run_tasks(out, [task], [WHOLE], seeds, conditions, make_variant)
        parts = arms_of([row for row in whole.rows if _task(row) == task])
        variants = [without(arm) for arm in arms or parts]
        variants += [WITHOUT_NOISE] if GRADIENT in parts and not arms else []
        run_tasks(out, [task], variants, seeds, conditions, make_variant)
    return Records(out / "rows.csv", COLUMNS, KEYS)


def arms_of(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """The arms that had a part in the whole race's policies and can be left out."""
    found = {name for row in rows if row["planner"] == WHOLE for name in row["arms"].split("; ")}
    return [name for name in OPTIONAL_ARMS if name in found]


def ablation_table(records: Records) -> str:
    """Markdown: what each arm is worth, over the tasks and on each of them."""
    tasks: dict[Task, dict[str, list[Mapping[str, str]]]] = {}
    for row in records.rows:
        tasks.setdefault(_task(row), {}).setdefault(row["planner"], []).append(row)
    whole = {task: rows[WHOLE] for task, rows in tasks.items() if WHOLE in rows}
    known = {without(arm): arm for arm in OPTIONAL_ARMS} | {WITHOUT_NOISE: NOISE}
    # rows may be of arms that have gone since
    left_out = {row["planner"] for row in records.rows if row["planner"].startswith(without(""))}
    shown = {name: arm for name, arm in known.items() if name in left_out}
    shown |= {name: name.removeprefix(without("")) for name in sorted(left_out - {*shown})}
    verdicts: dict[str, list[str]] = {arm: [] for arm in shown.values()}
    details = []
    for task, rows in whole.items():
        for variant, arm in shown.items():
            if variant not in tasks[task]:
                continue
            cells, sign = paired(rows, tasks[task][variant])
            verdict = _VERDICTS[sign]
            verdicts[arm].append(verdict)
            details.append([task.problem, task.instance, arm, *cells, verdict])
    seeds = max((len(rows) for rows in whole.values()), default=0)
    lines = [
        f"{len(whole)} tasks, seeds of each: {seeds}. Worse without it, better without it: the 95% "
        "interval of the difference, paired over the episodes, of means over the seeds.",
        "",
        "| arm | left out on | worse without it | as good | better without it |",
        "|---|---|---|---|---|",
        *(table_row([arm, len(found), *_counts(found)]) for arm, found in verdicts.items()),
        "",
        "| problem | instance | arm | with | without | lost without it (95% interval) | verdict |",
        "|---|---|---|---|---|---|---|",
        *(table_row(cells) for cells in details),
    ]
    return "\n".join(lines) + "\n"


# without the arm, by the sign of what is lost then
_VERDICTS = {1: "worse", 0: "as good", -1: "better"}


def _counts(verdicts: Sequence[str]) -> list[int]:
    return [verdicts.count(name) for name in _VERDICTS.values()]


def _task(row: Mapping[str, str]) -> Task:
    return Task(row["problem"], row["instance"])
