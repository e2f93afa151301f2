"""Every problem of rddlrepository: is what random policies play legal, and what is not counted?"""

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from benchmarks.common.markdown import escaped
from benchmarks.common.records import Records
from benchmarks.problems.agreement import make_planner, random_policies
from benchmarks.problems.compatibility import checked_problems, first_instance
from benchmarks.problems.each import KEYS, add_rows
from benchmarks.problems.inspection import BREACHES, Inspector
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.memory import peak_mb
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.episode import Episode
from mdpo_rddl.problem.evaluation import episode_seeds
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

_COUNTS = ("steps", "refused", "replaced", *BREACHES, "unsaid")
_COLUMNS = ("status", "cause", "policies", *_COUNTS, "seconds", "peak_mb")
# standard deviations of the weights: from nearly the no-op to the edge of 32 and 64 bits
_SPREADS = (0.1, 1.0, 3.0, 30.0, 1e3, 1e6, 2.0**31, 2.0**63, 1e25, 1e38)


class Item(NamedTuple):
    """One problem to play.

    Attributes:
      problem, instance: names of rddlrepository.
      policies: how many.
      steps: of each policy's episode, at most.
    """

    problem: str
    instance: str
    policies: int
    steps: int


def run_legal_play(
    out: Path, problems: Iterable[str] | None, policies: int, steps: int, limits: Limits
) -> Records:
    """Plays random policies on the first instance of each problem, each in a process of its own.

    Rows that `out/rows.csv` holds already are skipped.

    Args:
      out: results folder.
      problems: names of rddlrepository; all of it if None.
      policies: how many on each problem.
      steps: of each policy's episode, at most.
      limits: for each problem.

    Raises:
      InputError: for an unknown problem.
    """
    conditions = {"policies": policies, "steps": steps, "versions": versions()}
    records = Records(out / "rows.csv", (*KEYS, *_COLUMNS), KEYS, conditions)
    items = [
        Item(name, first_instance(name), policies, steps) for name in checked_problems(problems)
    ]
    return add_rows(records, _COLUMNS, items, check, limits)


def check(item: Item) -> dict[str, Any]:
    """Plays on one problem; an error becomes the status and its one-line cause."""
    started = time.perf_counter()
    row: dict[str, Any] = {"status": "ok", "cause": "", "policies": item.policies}
    try:
        problem = load_problem(item.problem, item.instance)
        if problem.horizon > item.steps:
            problem = load_problem(item.problem, item.instance, item.steps)
        row |= play(problem, np.resize(_SPREADS, item.policies))
        if row["unsaid"]:
            row.update(status="unsaid", cause="an illegal action was sent and not counted")
        elif any(row[name] for name in BREACHES):
            row.update(status="counted", cause="no legal action was found, which was counted")
    except Exception as error:  # whatever it is, it is the finding
        row.update(status="error", cause=one_line_cause(error))
    row["seconds"] = round(time.perf_counter() - started, 1)
    row["peak_mb"] = round(peak_mb())
    return row


def play(problem: Problem, spreads: np.ndarray) -> dict[str, int]:
    """Plays an episode of one random policy for each spread of its weights.

    Returns:
      `steps`; how many actions the referee `refused`, and how many of these it `replaced` by legal
      ones; of what was sent, how many actions broke which rule; how many of these are `unsaid`.
    """
    planner, env = make_planner(problem), make_environment(problem)
    policies = random_policies(planner, spreads)
    inspector = Inspector(env)
    for number, seed in enumerate(episode_seeds(0, len(spreads))):
        one = jax.tree.map(lambda leaf, n=number: leaf[n], policies)
        episode = Episode(env, playable(planner, one, {}, number), inspector)
        episode.play(env.reset(seed=seed)[0])
    return inspector.counts


def legal_play_table(records: Records) -> str:
    """Markdown: totals, and the problems where something was refused, broken or not played."""
    rows = sorted(records.rows, key=lambda row: row["problem"])
    played = [row for row in rows if row["steps"]]
    total = {name: sum(int(row[name]) for row in played) for name in _COUNTS}
    lines = [
        f"{len(played)} of {len(rows)} problems were played, {total['steps']:,} steps in all.",
        f"The last layer of the policies left {total['refused']:,} actions illegal, of which "
        f"{total['replaced']:,} were replaced. Sent and not counted: {total['unsaid']:,}.",
        "",
        f"| problem | instance | result | {' | '.join(_COUNTS)} |",
        "|" + "---|" * (3 + len(_COUNTS)),
    ]
    for row in rows:
        if row["status"] == "ok" and row["refused"] == "0":
            continue
        result = row["status"] + (f": {row['cause']}" if row["cause"] else "")
        cells = [row["problem"], row["instance"], escaped(result)]
        lines.append("| " + " | ".join([*cells, *(row[name] for name in _COUNTS)]) + " |")
    return "\n".join(lines) + "\n"
