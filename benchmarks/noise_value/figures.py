"""The pictures of noise-value: a dot for each task, and the learning curves that differ most."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.noise_value.methods import DEFAULT, NONE, TWICE
from mdpo_rddl.machine.pictures import write_picture

# Okabe and Ito's colours, which colour-blind readers can tell apart
_COLOURS = ("#000000", "#999999", "#56b4e9", "#009e73", "#e69f00", "#d55e00", "#cc79a7")
_SHOWN = 3

Scores = Mapping[Any, Mapping[str, np.ndarray]]


def draw_strips(path: Path, scores: Scores, methods: Sequence[str]) -> None:
    """Draws each method's lead over no noise in normalised score, one dot a task.

    Args:
      path: the picture's file.
      scores: per task and method the seeds' scores [S].
      methods: from left to right.
    """
    figure = Figure(figsize=(1.6 * max(3, len(methods)), 4.0), layout="constrained")
    axes = figure.subplots()
    generator = np.random.default_rng(0)
    for place, method in enumerate(methods):
        leads = [s[method].mean() - s[NONE].mean() for s in scores.values()]
        spread = generator.uniform(-0.15, 0.15, len(leads))
        colour = _COLOURS[(place + 1) % len(_COLOURS)]
        axes.plot(place + spread, leads, "o", color=colour, alpha=0.7, markersize=4)
        axes.hlines(np.mean(leads), place - 0.3, place + 0.3, color=colour)
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_xticks(range(len(methods)), methods)
    axes.set(ylabel="normalised score minus that without noise", title="a dot a task, line: mean")
    write_picture(figure, path, dpi=110)


def draw_curves(path: Path, results: Mapping[Any, Mapping[str, Any]], scores: Scores) -> None:
    """Draws the best test return so far where the default's noise gains and loses most.

    It is compared with a second update without noise, which costs about the same.

    Args:
      path: the picture's file.
      results: per task what its cell holds.
      scores: per task and method the seeds' scores [S].
    """
    leads = {t: scores[t][DEFAULT].mean() - scores[t][TWICE].mean() for t in results}
    ordered = sorted(results, key=lambda task: leads[task])
    gains, losses = ordered[::-1][:_SHOWN], ordered[:_SHOWN]
    figure = Figure(figsize=(4.0 * _SHOWN, 6.4), layout="constrained")
    panels = figure.subplots(2, _SHOWN, squeeze=False)
    for row, tasks, title in zip(panels, (gains, losses), ("gain", "loss"), strict=True):
        for axes in row[len(tasks) :]:
            axes.set_axis_off()
        for axes, task in zip(row, tasks, strict=False):
            _draw_task(axes, results[task])
            lead = f"{title} {leads[task]:+.2f}"
            axes.set_title(f"{lead}: {task[0]} {task[1]}\n{task[2]}, {task[3]}", fontsize=9)
    panels[0][0].legend(fontsize=7)
    write_picture(figure, path, dpi=110)


def _draw_task(axes: Axes, found: Mapping[str, Any]) -> None:
    for place, (method, kept) in enumerate(found["methods"].items()):
        colour = _COLOURS[place % len(_COLOURS)]
        curves = np.asarray(kept["curves"], float)
        axes.plot(found["curve_iterations"], np.mean(curves, axis=0), color=colour, label=method)
    axes.set(xlabel="iteration", ylabel="best test return")
