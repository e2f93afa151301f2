"""Small panels of trajectories: one for each object of a fluent."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.problem.trajectories import KINDS, Fluent, Trajectories
from mdpo_rddl.session.report.page.style import Picture
from mdpo_rddl.session.report.page.svg import Axis, Band, Layout, Line, Mark, chart, steps

_MOST_PANELS, _MOST_OF_A_FLUENT = 84, 12
_LOW, _HIGH = 0.1, 0.9
# the longest enumeration whose values are named at the axis
_MOST_NAMES = 5
# more characters of a title than fit above a panel
_LONGEST_TITLE = 80
_LAYOUT = Layout(195.0, 135.0, 9.5)


@dataclass(frozen=True, eq=False)
class Series:
    """What is drawn in one colour.

    Attributes:
      name: for the legend.
      colour: of the line and the band.
      is_dashed: whether the line is.
      play: whose trajectories.
    """

    name: str
    colour: str
    is_dashed: bool
    play: Trajectories


@dataclass(frozen=True)
class FluentPanels:
    """The panels of one fluent.

    Attributes:
      fluent: which.
      panels: one an object, the busiest first.
      left_out: objects without a panel.
    """

    fluent: Fluent
    panels: tuple[Picture, ...]
    left_out: int


def draw_panels(series: Sequence[Series]) -> list[FluentPanels]:
    """Draws every fluent's panels, states first: median and quantile bands over the episodes.

    Of bools the share of episodes in which they are true is drawn.

    Args:
      series: what to compare, of the same problem; the first one says which objects are busy.
    """
    if not series:
        return []
    fluents = [f for kind in KINDS for f in series[0].play.fluents if f.kind == kind]
    most = max(1, min(_MOST_OF_A_FLUENT, _MOST_PANELS // max(1, len(fluents))))
    plays = [each.play for each in series]
    drawn = []
    for fluent in fluents[:_MOST_PANELS]:
        key = fluent.kind, fluent.name
        places = _busiest([play.values[key] for play in plays])[:most]
        panels = tuple(_panel(series, fluent, int(place)) for place in places)
        drawn.append(FluentPanels(fluent, panels, fluent.count - len(panels)))
    return drawn


def _busiest(values: Sequence[np.ndarray]) -> np.ndarray:
    """Places of the objects by how much they change from step to step, the most first.

    Of those that change alike, those whose first values differ most from the other series' come
    first.

    Args:
      values: of each series, [episodes, T, objects].
    """
    first = values[0]
    changes = np.nan_to_num(np.abs(np.diff(first, axis=1))).sum(axis=(0, 1))
    apart = np.zeros_like(changes)
    for other in values[1:]:
        shared = min(len(first), len(other))
        gaps = np.nan_to_num(np.abs(first[:shared] - other[:shared]))
        apart += gaps.sum(axis=(0, 1))
    return np.lexsort((-apart, -changes))


def _panel(series: Sequence[Series], fluent: Fluent, place: int) -> Picture:
    """The picture of one object."""
    bands, lines = list[Mark](), list[Mark]()
    for each in reversed(series):
        values = each.play.values[fluent.kind, fluent.name][:, :, place]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of steps that no episode has reached
            if fluent.range == "bool":
                middle = np.nanmean(values, axis=0)
            else:
                low, middle, high = quantiles(values)
                bands.append(Band(each.play.steps, low, high, each.colour))
        points = each.play.steps, middle
        if fluent.kind == "action":  # which holds till the next step, a state is what is seen
            points = steps(*points)
        lines.append(Line(*points, each.colour, 1.5, each.is_dashed))
    objects = fluent.objects[place]
    title = f"{fluent.name}({objects})" if objects else fluent.name
    text = f"{title} over the steps: {', '.join(each.name for each in series)}"
    x = Axis(most=3)
    return chart([*bands, *lines], x, _values(fluent), text, title[:_LONGEST_TITLE], _LAYOUT)


def _values(fluent: Fluent) -> Axis:
    """The axis of a fluent's values."""
    if fluent.range == "bool":
        return Axis(low=-0.05, high=1.05, ticks={0.0: "0", 0.5: "0.5", 1.0: "1"})
    if fluent.values and len(fluent.values) <= _MOST_NAMES:
        return Axis(ticks={float(n): name[:6] for n, name in enumerate(fluent.values)})
    return Axis(most=3)


def quantiles(values: np.ndarray) -> np.ndarray:
    """The low, the middle and the high quantile over the episodes that have reached a step.

    Args:
      values: [episodes, T], NaN after an episode's end.

    Returns:
      [3, T]; NaN where there is no episode.
    """
    levels = (_LOW, 0.5, _HIGH)
    lacking = np.isnan(values).any(axis=0)
    found = np.full((len(levels), values.shape[1]), np.nan)
    found[:, ~lacking] = np.quantile(values[:, ~lacking], levels, axis=0)
    if np.any(lacking):  # which takes ten times as long
        found[:, lacking] = np.nanquantile(values[:, lacking], levels, axis=0)
    return found
