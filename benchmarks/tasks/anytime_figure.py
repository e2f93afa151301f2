"""The picture of `anytime`: a panel a task, the return over the seconds of preparation."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.tasks.anytime import Returns
from mdpo_rddl.machine.pictures import write_picture

_COLUMNS = 4
_COLOUR = "#0072b2"


def draw_anytime(path: Path, returns: Returns) -> None:
    """Draws the median of the seeds, and between which returns they lie.

    Args:
      path: the picture's file.
      returns: as `read_anytime` has them; a seed without a return is left out.
    """
    rows = max(1, -(-len(returns) // _COLUMNS))
    figure = Figure(figsize=(3.4 * _COLUMNS, 2.5 * rows), layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in panels[len(returns) :]:
        axes.set_axis_off()
    for axes, (task, times) in zip(panels, returns.items(), strict=False):
        known = {time: means[np.isfinite(means)] for time, means in times.items()}
        known = {time: means for time, means in known.items() if len(means)}
        seconds = list(known)
        low, middle, high = (
            [float(value(means)) for means in known.values()]
            for value in (np.min, np.median, np.max)
        )
        axes.fill_between(seconds, low, high, color=_COLOUR, alpha=0.2, linewidth=0)
        axes.plot(seconds, middle, "o-", color=_COLOUR, markersize=3)
        axes.set_xscale("log")
        axes.set_xticks(seconds, [f"{time:g}" for time in seconds])
        axes.minorticks_off()
        axes.set_title(f"{task.problem} {task.instance}", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    figure.supxlabel("seconds of preparation", fontsize=9)
    figure.supylabel("mean return", fontsize=9)
    write_picture(figure, path, dpi=110)
