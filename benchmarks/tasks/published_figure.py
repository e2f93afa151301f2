"""The picture of the published tasks: how often each planner reaches a score."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.common.records import Records
from benchmarks.tasks.published import mean_returns, published, score
from benchmarks.tasks.trial import Task
from mdpo_rddl.machine.pictures import write_picture

OURS = "this package"
PLANNERS = {
    "PROST": "prost",
    "JaxPlan": "jaxplan",
    "GurobiPlan": "gurobiplan",
    "DiSProD": "disprod",
}
_TIMES = (1, 3, 5)
# Okabe and Ito's colours, which colour-blind readers can tell apart
_COLOURS = {
    OURS: "#d55e00",
    "PROST": "#0072b2",
    "JaxPlan": "#009e73",
    "GurobiPlan": "#e69f00",
    "DiSProD": "#999999",
}
_LEVELS = np.linspace(-0.1, 1.2, 261)

Scores = Mapping[Task, Mapping[str, float]]


def published_scores(records: Records) -> dict[Task, dict[str, float]]:
    """The score of each planner that has a return, for each task that was measured.

    The others' is that of the best of their returns at 1, 3 and 5 s a decision.
    """
    measured, scores = mean_returns(records), {}
    for task, row in published().items():
        if task not in measured:
            continue
        ours = measured[task]
        scores[task] = {OURS: 0.0 if ours is None else score(ours, row)}
        for name, column in PLANNERS.items():
            found = [row[f"{column}_{seconds}"] for seconds in _TIMES]
            if any(found):
                best = max(float(value) for value in found if value)
                scores[task][name] = score(best, row)
    return scores


def draw_published(path: Path, records: Records) -> None:
    """Draws a performance profile for the tasks of PROST, and one for the others.

    Args:
      path: the picture's file.
      records: of `run_published`, however many of its tasks they have.
    """
    scores = published_scores(records)
    discrete = {task: row for task, row in scores.items() if "PROST" in row}
    others = {task: row for task, row in scores.items() if task not in discrete}
    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _draw_profiles(left, discrete, f"discrete, {len(discrete)} tasks")
    _draw_profiles(right, others, f"continuous and mixed, {len(others)} tasks")
    left.set_ylabel("share of tasks")
    figure.suptitle(f"{len(scores)} of {len(published())} tasks measured", fontsize=10)
    write_picture(figure, path, dpi=130)


def _draw_profiles(axes: Axes, scores: Scores, title: str) -> None:
    names = [name for name in _COLOURS if any(name in row for row in scores.values())]
    for name in names:
        found = np.array([row[name] for row in scores.values() if name in row])
        share = np.mean(found[:, np.newaxis] >= _LEVELS, axis=0)
        width = 2.2 if name == OURS else 1.3
        axes.plot(_LEVELS, share, label=name, color=_COLOURS[name], linewidth=width)
    axes.axvline(1.0, color="#cccccc", linewidth=0.8, zorder=0)
    axes.set(title=title, xlabel="score of at least (1: the best published return)")
    axes.set_ylim(0.0, 1.02)
    axes.spines[["top", "right"]].set_visible(False)
    if names:
        axes.legend(frameon=False, loc="lower left")
