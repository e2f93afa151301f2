"""Small panels of trajectories: one for each object of a fluent."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, ScalarFormatter

from mdpo_rddl.problem.trajectories import KINDS, Fluent, Trajectories
from mdpo_rddl.session.report.page.style import Picture, rendered

_MOST_PANELS, _MOST_OF_A_FLUENT = 84, 12
_LOW, _HIGH = 0.1, 0.9
# the longest enumeration whose values are named at the axis
_MOST_NAMES = 5
# more characters of a title than fit above a panel: each takes its time
_LONGEST_TITLE = 80
_DPI = 150


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
    drawing = _Drawing(series)
    plays = [each.play for each in series]
    drawn = []
    for fluent in fluents[:_MOST_PANELS]:
        key = fluent.kind, fluent.name
        places = _busiest([play.values[key] for play in plays])[:most]
        panels = tuple(drawing.panel(fluent, int(place)) for place in places)
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


class _Drawing:
    """A figure that serves all panels: making one takes longer than drawing in it."""

    def __init__(self, series: Sequence[Series]) -> None:
        self._series = series
        self._figure = Figure(figsize=(1.95, 1.35))
        self._axes = self._figure.add_axes((0.2, 0.15, 0.77, 0.67))
        self._axes.tick_params(labelsize=7)
        self._axes.grid(alpha=0.25, linewidth=0.5)
        self._axes.margins(x=0.01, y=0.08)
        for side in ("top", "right"):
            self._axes.spines[side].set_visible(False)

    def panel(self, fluent: Fluent, place: int) -> Picture:
        """The picture of one object."""
        axes = self._axes
        for artist in [*axes.lines, *axes.collections]:
            artist.remove()
        for number, each in enumerate(self._series):
            self._draw(each, fluent, place, number)
        # after a panel of bools or names, the axis is its own again
        axes.set_autoscaley_on(True)
        axes.yaxis.set_major_formatter(ScalarFormatter())
        axes.relim()
        axes.autoscale_view()
        axes.xaxis.set_major_locator(MaxNLocator(3, integer=True))
        self._scale(fluent)
        objects = fluent.objects[place]
        title = f"{fluent.name}({objects})" if objects else fluent.name
        axes.set_title(title[:_LONGEST_TITLE], fontsize=7.5, loc="left", parse_math=False)
        names = ", ".join(each.name for each in self._series)
        text = f"{title} over the steps: {names}"
        return Picture(rendered(self._figure, _DPI), text)

    def _scale(self, fluent: Fluent) -> None:
        axes = self._axes
        axes.yaxis.set_major_locator(MaxNLocator(3))
        if fluent.range == "bool":
            axes.set_ylim(-0.05, 1.05)
            axes.yaxis.set_major_locator(FixedLocator([0.0, 0.5, 1.0]))
        elif fluent.values and len(fluent.values) <= _MOST_NAMES:
            axes.yaxis.set_major_locator(FixedLocator(range(len(fluent.values))))
            axes.set_yticklabels([name[:6] for name in fluent.values])

    def _draw(self, series: Series, fluent: Fluent, place: int, number: int) -> None:
        values = series.play.values[fluent.kind, fluent.name][:, :, place]
        steps, axes = series.play.steps, self._axes
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of steps that no episode has reached
            if fluent.range == "bool":
                middle = np.nanmean(values, axis=0)
            else:
                low, middle, high = quantiles(values)
                axes.fill_between(
                    steps, low, high, color=series.colour, alpha=0.2, linewidth=0, zorder=9 - number
                )
        style = "--" if series.is_dashed else "-"
        axes.plot(
            steps, middle, style, color=series.colour, linewidth=1.2, drawstyle=_drawn(fluent),
            zorder=19 - number,
        )  # fmt: skip


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


def _drawn(fluent: Fluent) -> str:
    """An action holds till the next step, a state is what is seen at a step."""
    return "steps-post" if fluent.kind == "action" else "default"
