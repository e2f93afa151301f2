"""The table of the tasks with published returns."""

import json
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.common.markdown import rounded, table_head, table_row
from benchmarks.common.records import Records
from benchmarks.tasks.paired import common_returns, paired_returns
from benchmarks.tasks.published import (
    mean_returns,
    published,
    score,
    score_in_equal_steps,
    shorter_returns,
)
from benchmarks.tasks.trial import ALONE, OK, SHORTER, Task
from mdpo_rddl.problem.evaluation import mean_interval

AT_THE_BEST = 0.99
_SIGNS = {"better": 1, "as good": 0, "worse": -1}
_OTHERS = {
    "PROST 1 s": "prost_1",
    "JaxPlan 1 s": "jaxplan_1",
    "GurobiPlan 1 s": "gurobiplan_1",
    "DiSProD 1 s": "disprod_1",
}


def published_table(records: Records) -> str:
    """Markdown: each task's mean return and score beside the others', and the totals."""
    is_shorter_known = SHORTER in records.columns
    measured = mean_returns(records)
    shorter = shorter_returns(records) if is_shorter_known else {}
    failed = {
        Task(record["problem"], record["instance"]): record["status"]
        for record in records.rows
        if record["status"] != OK
    }
    more = ["before the last step", "score in equal steps"] if is_shorter_known else []
    heads = ["problem", "instance", "ours", "score", *more, "best published", "by", *_OTHERS]
    lines = table_head((*heads, "no-op", "random"))
    scores = []
    for task, row in published().items():
        if task not in measured:
            continue
        ours = [measured[task], *([shorter[task]] if is_shorter_known else [])]
        scores.append(_scores(ours, row))
        shown = ["" if mean is None else rounded(mean, 6) for mean in ours]
        shown[0] = shown[0] or failed[task]
        pairs = zip(shown, scores[-1], strict=True)
        cells = [cell for mean, scored in pairs for cell in (mean, f"{scored:.3f}")]
        cells += [_number(row["best"]), row["best_by"]]
        cells += [_number(row[name]) for name in (*_OTHERS.values(), "noop", "random")]
        lines.append(table_row((task.problem, task.instance, *cells)))
    return "\n".join([*lines, "", " ".join(_said(records, np.array(scores), shorter))]) + "\n"


def _scores(ours: Sequence[float | None], row: Mapping[str, str]) -> list[float]:
    """Of the mean return, and in equal steps if the one before the last step is there, too."""
    means = [mean for mean in ours if mean is not None]
    if len(means) < len(ours):
        return [0.0] * len(ours)
    return [
        score(means[0], row),
        *(score_in_equal_steps(means[0], less, row) for less in means[1:]),
    ]


def _said(records: Records, scores: np.ndarray, shorter: Mapping[Task, float | None]) -> list[str]:
    """What the table comes to; scores [tasks, 1 or 2]."""
    if not scores.size:
        return [totals(scores)]
    said = [totals(scores[:, 0])]
    if scores.shape[1] == 1:
        return [*said, *_certainly_below(records), *against_alone(records)]
    equal = f"The same in equal steps: {totals(scores[:, 1])}"
    behind = _behind_prost(mean_returns(records)), _behind_prost(shorter)
    prost = f"Mean below PROST's with 1 s: {behind[0]}; before the last step {behind[1]}."
    return [*said, equal, prost, *against_alone(records)]


def _behind_prost(means: Mapping[Task, float | None]) -> str:
    """On which domains PROST's mean with 1 s a decision is above ours, and both.

    Args:
      means: of our returns on the tasks, None where it failed.
    """
    domains: dict[str, list[tuple[float, float]]] = {}
    for task, row in published().items():
        if row["prost_1"] and task in means:
            ours = means[task]
            failed = -np.inf if ours is None else ours
            domains.setdefault(task.problem, []).append((failed, float(row["prost_1"])))
    behind = []
    for problem, pairs in domains.items():
        ours, prost = np.mean(pairs, axis=0)
        if ours < prost:
            shown = rounded(ours, 4) if np.isfinite(ours) else "failed"
            behind.append(f"{problem} ({shown}, PROST {rounded(prost, 4)})")
    return f"on {len(behind)} of {len(domains)} domains{_listed(behind)}"


def _listed(names: Sequence[str]) -> str:
    return f": {', '.join(names)}" if names else ""


def _number(text: str) -> str:
    return rounded(float(text), 6) if text else ""


def _certainly_below(records: Records) -> list[str]:
    """On how many tasks the episodes are enough to tell that ours is below the best."""
    measured = mean_returns(records)
    below = 0
    for task, row in published().items():
        if task not in measured:
            continue
        place = task.problem, task.instance, OK
        keys = "problem", "instance", "status"
        played = [each for each in records.rows if tuple(each[key] for key in keys) == place]
        returns = common_returns(played) if played else None
        interval = (-np.inf, -np.inf) if returns is None else mean_interval(returns)
        below += interval is not None and score(interval[1], row) < AT_THE_BEST
    return [f"Below {AT_THE_BEST:g} with all of the 95% interval of its episodes: {below}."]


def against_alone(records: Records) -> list[str]:
    """How long decisions were, and where trials had chosen to use that; nothing without time."""
    times = {row["decision_seconds"] for row in records.rows if row.get("decision_seconds")}
    if not times:
        return []
    chosen = [row for row in records.rows if row["method"]]
    tasks = {Task(row["problem"], row["instance"]) for row in chosen}
    count = f"{len(tasks)} task" if len(tasks) == 1 else f"{len(tasks)} tasks"
    said = f"Ours with {', '.join(sorted(times))} s a decision, used on {count}."
    signs = [
        paired_returns(np.array(json.loads(row["returns"])), np.array(json.loads(row[ALONE]))).sign
        for row in chosen
        if row[ALONE]
    ]
    if not signs:
        return [said]
    counts = ", ".join(f"{name} on {signs.count(sign)}" for name, sign in _SIGNS.items())
    return [said, f"Against the same policy alone in the same episodes: {counts}."]


def totals(scores: np.ndarray, best: str = "the best published return") -> str:
    """How many tasks reach the best, and the mean score.

    Args:
      scores: of the tasks, as `score` gives them.
      best: what a score of 1 stands for.
    """
    if not scores.size:
        return "No task has been played."
    reached = int(np.sum(scores >= AT_THE_BEST))
    mean = float(np.mean(np.minimum(scores, 1.0)))
    return (
        f"At {AT_THE_BEST:g} of {best} or above: {reached} of {len(scores)}. "
        f"Mean score, each at most 1: {mean:.3f}. Below 0: {int(np.sum(scores < 0.0))}."
    )
