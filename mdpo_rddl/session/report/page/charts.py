"""Pictures of returns, of searches and of decision times."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from mdpo_rddl.machine.pictures import literal
from mdpo_rddl.session.report.page.style import Picture, rendered

_DIVISIONS = 30


class Returns(NamedTuple):
    """Returns to draw as one row.

    Attributes:
      name: of whom.
      colour: of the dots.
      returns: of the episodes.
      interval: of the mean; None if there is none.
    """

    name: str
    colour: str
    returns: np.ndarray
    interval: tuple[float, float] | None


def draw_returns(rows: Sequence[Returns], title: str = "") -> Picture:
    """A row of dots for each, an episode a dot, with the mean and its interval."""
    figure = Figure(figsize=(5.6, 0.75 + 0.55 * len(rows)), layout="constrained")
    axes = figure.subplots()
    shift = np.random.default_rng(0)  # only where dots would hide each other
    for place, row in enumerate(reversed(rows)):
        finite = row.returns[np.isfinite(row.returns)]
        heights = place + shift.uniform(-0.18, 0.18, len(finite))
        axes.plot(finite, heights, "o", color=row.colour, markersize=3.5, alpha=0.35, mew=0)
        if not len(finite):
            continue
        mean = float(np.mean(finite))
        if row.interval is not None:
            axes.plot(row.interval, [place, place], color=row.colour, linewidth=3.0)
        axes.plot([mean], [place], "|", color=row.colour, markersize=18, mew=2.5)
    axes.set_yticks(range(len(rows)), [row.name for row in reversed(rows)], parse_math=False)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.set_xlabel("return of an episode; mean and 95% interval")
    axes.set_title(title, parse_math=False)
    axes.grid(axis="x", alpha=0.25)
    names = ", ".join(row.name for row in rows)
    return Picture(rendered(figure), f"returns of the episodes: {names}")


def draw_distribution(row: Returns) -> Picture:
    """A histogram of the returns of one."""
    figure = Figure(figsize=(5.6, 2.2), layout="constrained")
    axes = figure.subplots()
    finite = row.returns[np.isfinite(row.returns)]
    axes.hist(finite, bins=min(_DIVISIONS, max(5, len(finite) // 2)), color=row.colour, alpha=0.8)
    if len(finite):
        axes.axvline(float(np.mean(finite)), color="#222222", linewidth=1.2)
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.set(xlabel=f"return of an episode, {literal(row.name)}", ylabel="episodes")
    axes.grid(axis="y", alpha=0.25)
    return Picture(rendered(figure), f"distribution of the returns of {row.name}")


def draw_searches(
    races: Mapping[str, tuple[str, Sequence[Mapping[str, Any]]]], title: str = ""
) -> Picture:
    """The incumbent of each run over seconds.

    Args:
      races: by the run's name its colour and its candidates.
      title: of the picture.
    """
    figure = Figure(figsize=(5.6, 3.0), layout="constrained")
    axes = figure.subplots()
    for name, (colour, candidates) in races.items():
        steps = [c for c in candidates if c["became_incumbent"] and c["mean_return"] is not None]
        if not steps:
            continue
        seconds = [c["seconds"] for c in steps] + [candidates[-1]["seconds"]]
        returns = [c["mean_return"] for c in steps] + [steps[-1]["mean_return"]]
        axes.step(
            seconds,
            returns,
            where="post",
            color=colour,
            linewidth=1.6,
            label=literal(name),
        )
    axes.set(xlabel="wall-clock time (s)", ylabel="return on the exact model")
    axes.set_title(title, parse_math=False)
    axes.yaxis.set_major_formatter(EngFormatter())
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize="small")
    return Picture(rendered(figure), f"incumbents over seconds: {', '.join(races)}")


def draw_decision_times(seconds: np.ndarray, budget: float | None) -> Picture:
    """A histogram of the decision times, with the budget of a decision if there was one."""
    figure = Figure(figsize=(5.6, 2.2), layout="constrained")
    axes = figure.subplots()
    milliseconds = np.maximum(1e3 * seconds, 1e-3)
    low, high = float(milliseconds.min()), float(milliseconds.max())
    edges = np.geomspace(0.9 * low, 1.1 * high, _DIVISIONS + 1)
    axes.hist(milliseconds, bins=edges.tolist(), color="#1f6f8b", alpha=0.8)
    axes.set_xscale("log")
    axes.set_yscale("log")
    if budget:
        axes.axvline(1e3 * budget, color="#c8553d", linestyle="--", label="time per decision")
        axes.legend(frameon=False, fontsize="small")
    axes.set(xlabel="time per decision (ms)", ylabel="decisions")
    axes.grid(alpha=0.25)
    return Picture(rendered(figure), "distribution of the times of the decisions")
