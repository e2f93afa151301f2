"""The picture of `everywhere`: a line a problem, on which each planner's mean return is a dot."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.common.records import Records
from benchmarks.tasks.everywhere import by_task
from benchmarks.tasks.names import OURS
from benchmarks.tasks.trial import OK
from mdpo_rddl.machine.pictures import write_picture

_PANELS = 2
# drawn in this order, ours on top; the colours are Okabe and Ito's
_DOTS = {
    "noop": ("no-op", "#999999", 14.0),
    "random": ("random", "#56b4e9", 14.0),
    "jaxplan-drp": ("JaxPlan, policy", "#e69f00", 20.0),
    "jaxplan-slp": ("JaxPlan, plan", "#009e73", 20.0),
    OURS: ("this package", "#d55e00", 26.0),
}

Shares = Mapping[str, float]
"""By planner: 0 at the smallest mean return of those compared, 1 at the largest."""


def shares_of(records: Records) -> dict[str, Shares]:
    """Of each task that two planners have played where each lies between the worst and the best.

    All are 1 where all are the same. A planner without returns is left out. A task is named by its
    problem, and by its instance where there are several of that.
    """
    found: dict[str, Shares] = {}
    tasks = by_task(records)
    count = Counter(problem for problem, _ in tasks)
    for (problem, instance), rows in tasks.items():
        means = {name: float(row["mean"]) for name, row in rows.items() if row["status"] == OK}
        if len(means) < 2:
            continue
        low, high = min(means.values()), max(means.values())
        width = high - low
        found[problem if count[problem] == 1 else f"{problem} {instance}"] = {
            name: (mean - low) / width if width > 0.0 else 1.0 for name, mean in means.items()
        }
    return found


def draw_everywhere(path: Path, records: Records) -> None:
    """Draws all problems that two planners have played.

    Args:
      path: the picture's file.
      records: of `run_everywhere`, however many rows they have.
    """
    shares = list(shares_of(records).items())
    rows = max(1, -(-len(shares) // _PANELS))
    figure = Figure(figsize=(11.0, 1.6 + 0.17 * rows), layout="constrained")
    for panel, axes in enumerate(figure.subplots(1, _PANELS)):
        _draw(axes, shares[panel * rows : (panel + 1) * rows])
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper center", ncols=len(_DOTS), frameon=False)
    figure.supxlabel("mean return, from the worst to the best of those compared", fontsize=9)
    write_picture(figure, path, dpi=110)


def _draw(axes: Axes, problems: Sequence[tuple[str, Shares]]) -> None:
    heights = np.arange(len(problems))
    axes.hlines(heights, 0.0, 1.0, color="#eeeeee", linewidth=0.8, zorder=0)
    for layer, (name, (label, colour, size)) in enumerate(_DOTS.items(), start=1):
        places = [shares.get(name, np.nan) for _, shares in problems]
        axes.scatter(places, heights, s=size, color=colour, label=label, zorder=layer)
    axes.set_yticks(heights, [problem for problem, _ in problems], fontsize=6.5)
    axes.set_ylim(len(problems) - 0.4, -0.6)
    axes.set_xticks([0.0, 1.0], ["worst", "best"], fontsize=8)
    axes.tick_params(length=0)
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)
