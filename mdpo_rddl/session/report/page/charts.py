"""Pictures of returns, of searches and of decision times."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.session.report.page.style import Picture
from mdpo_rddl.session.report.page.svg import Axis, Bars, Dots, Layout, Line, Mark, chart, steps

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
    shift = np.random.default_rng(0)  # only where dots would hide each other
    marks: list[Mark] = []
    for place, row in enumerate(reversed(rows)):
        finite = row.returns[np.isfinite(row.returns)]
        marks.append(Dots(finite, place + shift.uniform(-0.18, 0.18, len(finite)), row.colour))
        if not len(finite):
            continue
        mean = float(np.mean(finite))
        if row.interval is not None:
            marks.append(Line(np.array(row.interval), np.full(2, place), row.colour, 4.0))
        ends = np.array([place - 0.3, place + 0.3])
        marks.append(Line(np.full(2, mean), ends, row.colour, 3.0))
    names = {float(place): row.name for place, row in enumerate(reversed(rows))}
    return chart(
        marks,
        Axis("return of an episode; mean and 95% interval"),
        Axis(low=-0.6, high=len(rows) - 0.4, ticks=names),
        f"returns of the episodes: {', '.join(row.name for row in rows)}",
        title,
        Layout(height=75.0 + 55.0 * len(rows)),
    )


def draw_distribution(row: Returns) -> Picture:
    """A histogram of the returns of one."""
    finite = row.returns[np.isfinite(row.returns)]
    marks: list[Mark] = []
    if len(finite):
        bins = min(_DIVISIONS, max(5, len(finite) // 2))
        heights, edges = np.histogram(finite, bins=bins)
        marks.append(Bars(edges, heights, row.colour))
        mean = np.full(2, np.mean(finite))
        marks.append(Line(mean, np.array([-np.inf, np.inf]), "#222222", 1.2))
    return chart(
        marks,
        Axis(f"return of an episode, {row.name}"),
        Axis("episodes", low=0.0, most=4),
        f"distribution of the returns of {row.name}",
        layout=Layout(height=220.0),
    )


def draw_searches(
    races: Mapping[str, tuple[str, Sequence[Mapping[str, Any]]]], title: str = ""
) -> Picture:
    """The incumbent of each run over seconds.

    Args:
      races: by the run's name its colour and its candidates.
      title: of the picture.
    """
    marks: list[Mark] = []
    for name, (colour, candidates) in races.items():
        best = [c for c in candidates if c["became_incumbent"] and c["mean_return"] is not None]
        if not best:
            continue
        seconds = [c["seconds"] for c in best] + [candidates[-1]["seconds"]]
        returns = [c["mean_return"] for c in best] + [best[-1]["mean_return"]]
        marks.append(Line(*steps(np.array(seconds), np.array(returns)), colour, label=name))
    return chart(
        marks,
        Axis("wall-clock time (s)"),
        Axis("return on the exact model"),
        f"incumbents over seconds: {', '.join(races)}",
        title,
        Layout(height=300.0 + 16.0 * len(marks)),
    )


def draw_decision_times(seconds: np.ndarray, budget: float | None) -> Picture:
    """A histogram of the decision times, with the budget of a decision if there was one."""
    milliseconds = np.maximum(1e3 * seconds, 1e-3)
    low, high = float(milliseconds.min()), float(milliseconds.max())
    edges = np.geomspace(0.9 * low, 1.1 * high, _DIVISIONS + 1)
    marks: list[Mark] = [Bars(edges, np.histogram(milliseconds, edges)[0], "#1f6f8b")]
    if budget:
        ends = np.array([-np.inf, np.inf])
        label = "time per decision"
        marks.append(Line(np.full(2, 1e3 * budget), ends, "#c8553d", 1.6, True, label))
    return chart(
        marks,
        Axis("time per decision (ms)", is_log=True),
        Axis("decisions", low=0.5, is_log=True),
        "distribution of the times of the decisions",
        layout=Layout(height=220.0),
    )
