"""Charts as SVG: a browser scales them, and nothing large is imported to draw them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup, escape

from mdpo_rddl.session.report.page.style import Picture

# a unit of the drawing is a tenth of a pixel: whole numbers are short and quick to write
_UNITS = 10
# of the letters: heights of a line, widths of a character
_LINE_HEIGHT, _CHARACTER = 1.5, 0.6
_PAD = 8.0
# of the data's range, on either side
_MARGIN = 0.05
# less of the largest number is no range: its ticks would be all the same
_LEAST_RANGE = 1e-6
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_PREFIXES = {12: "T", 9: "G", 6: "M", 3: "k", 0: ""}
_LONG = 1e4
_GRID, _INK = "#e3e7ea", "#4a545c"


class Line(NamedTuple):
    """A line through points; NaN interrupts it, an infinite number is the end of the axis.

    Attributes:
      x, y: of the points [N].
      colour: in CSS's words.
      width: in pixels.
      is_dashed: whether it is.
      label: in the legend, if any.
    """

    x: np.ndarray
    y: np.ndarray
    colour: str
    width: float = 1.6
    is_dashed: bool = False
    label: str = ""


class Band(NamedTuple):
    """What lies between two lines; NaN interrupts it.

    Attributes:
      x, low, high: [N].
      colour: in CSS's words.
    """

    x: np.ndarray
    low: np.ndarray
    high: np.ndarray
    colour: str


class Dots(NamedTuple):
    """Points that may hide each other.

    Attributes:
      x, y: [N].
      colour: in CSS's words.
      size: in pixels.
      label: in the legend, if any.
    """

    x: np.ndarray
    y: np.ndarray
    colour: str
    size: float = 6.0
    label: str = ""


class Bars(NamedTuple):
    """Bars that stand side by side on the lower end of the axis.

    Attributes:
      edges: [N + 1].
      heights: [N].
      colour: in CSS's words.
    """

    edges: np.ndarray
    heights: np.ndarray
    colour: str


Mark = Line | Band | Dots | Bars


class Axis(NamedTuple):
    """An axis.

    Attributes:
      label: beside it.
      low, high: its ends; of the data if None.
      is_log: whether equal distances are equal ratios.
      ticks: what is written where; round numbers if None.
      most: the most of these, about.
    """

    label: str = ""
    low: float | None = None
    high: float | None = None
    is_log: bool = False
    ticks: Mapping[float, str] | None = None
    most: int = 6


class Layout(NamedTuple):
    """How large a chart is, in pixels.

    Attributes:
      width, height: of all.
      font: size of the letters.
    """

    width: float = 560.0
    height: float = 300.0
    font: float = 11.0


CHART = Layout()
"""Of half the page's width."""


def chart(
    marks: Sequence[Mark],
    x: Axis,
    y: Axis,
    text: str,
    title: str = "",
    layout: Layout = CHART,
) -> Picture:
    """Draws marks on a pair of axes, the first ones below the others.

    Args:
      marks: what is drawn.
      x, y: the axes.
      text: what the chart shows, for whoever does not see it.
      title: above it, on one line.
      layout: its size.

    Raises:
      ValueError: if numbers are too large to be drawn.
    """
    font = layout.font
    across = _Scale(x, [value for mark in marks for value in _xs(mark)])
    up = _Scale(y, [value for mark in marks for value in _ys(mark)])
    legend = [mark for mark in marks if isinstance(mark, Line | Dots) and mark.label]
    row = _LINE_HEIGHT * font
    widest = max((len(word) for _, word in up.ticks), default=0)
    left = _PAD + _CHARACTER * font * widest + (row if y.label else 0.0)
    top = (row if title else 0.5 * row) + row * len(legend)
    bottom = layout.height - row * (2.0 if x.label else 1.0) - 0.25 * row
    across.place(left, layout.width - _PAD)
    up.place(bottom, top)
    parts = [*_axes(across, up, font), *(_drawn(mark, across, up) for mark in marks)]
    middle = 0.5 * (top + bottom)
    if title:
        parts.append(_word(left, 0.75 * row, title, font + 1.0, "start"))
    if x.label:
        parts.append(_word(0.5 * (left + layout.width), layout.height - 0.4 * row, x.label, font))
    if y.label:
        turn = f' transform="rotate(-90 {_at(0.75 * row)} {_at(middle)})"'
        parts.append(_word(0.75 * row, middle, y.label, font, more=turn))
    for number, mark in enumerate(legend):
        at = (row if title else 0.5 * row) + row * (number + 0.35)
        ends = np.array([left, left + 2.0 * font])
        parts.append(_stroke(ends, np.full(2, at), mark))
        parts.append(_word(left + 2.6 * font, at + 0.35 * font, mark.label, font, "start"))
    size = f'viewBox="0 0 {_at(layout.width)} {_at(layout.height)}"'
    head = f'<svg role="img" aria-label="{escape(text)}" {size} font-size="{_at(font)}">'
    return Picture(Markup(head + "".join(parts) + "</svg>"), text)


def _xs(mark: Mark) -> tuple[np.ndarray, ...]:
    return (mark.edges,) if isinstance(mark, Bars) else (mark.x,)


def _ys(mark: Mark) -> tuple[np.ndarray, ...]:
    if isinstance(mark, Band):
        return mark.low, mark.high
    return (mark.heights,) if isinstance(mark, Bars) else (mark.y,)


class _Scale:
    """From numbers to pixels along an axis.

    Attributes:
      ticks: numbers, and what is written there.
      ends: pixels of the axis's ends, once it is placed.
    """

    def __init__(self, axis: Axis, values: Sequence[np.ndarray]) -> None:
        known = np.concatenate([np.ravel(each) for each in values]) if values else np.zeros(0)
        known = known[np.isfinite(known)].astype(float)
        self._is_log = axis.is_log
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        low, high = self._with_margin(low, high)
        self._low = low if axis.low is None else axis.low
        self._high = high if axis.high is None else axis.high
        if not math.isfinite(self._high - self._low):
            raise ValueError("numbers that are too large to be drawn")
        if axis.ticks is not None:
            self.ticks = list(axis.ticks.items())
        elif self._is_log:
            self.ticks = list(_powers(self._low, self._high))
        else:
            self.ticks = list(round_ticks(self._low, self._high, axis.most))
        self.ends = 0.0, 1.0

    def _with_margin(self, low: float, high: float) -> tuple[float, float]:
        if self._is_log:
            return low / 1.1, high * 1.1
        if high - low <= _LEAST_RANGE * max(abs(low), abs(high)):
            half = 0.1 * abs(high) or 0.5
            return low - half, high + half
        margin = _MARGIN * (high - low)
        return low - margin, high + margin

    def place(self, first: float, last: float) -> None:
        """Says which pixels the ends are."""
        self.ends = first, last

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Pixels; what is beyond an end is there."""
        (first, last), clipped = self.ends, np.clip(values, self._low, self._high)
        if self._is_log:
            share = np.log(clipped / self._low) / math.log(self._high / self._low)
        else:
            share = (clipped - self._low) / (self._high - self._low)
        return np.asarray(first + (last - first) * share)


def round_ticks(low: float, high: float, most: int) -> Iterator[tuple[float, str]]:
    """Round numbers from low to high, at most about so many, and how they are written."""
    rough = (high - low) / max(1, most)
    scale = 10.0 ** math.floor(math.log10(rough))
    step = next(scale * each for each in _STEPS if scale * each >= rough * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    power = 0
    if max(abs(first), abs(last)) * step >= _LONG:
        power = next((p for p in _PREFIXES if max(abs(first), abs(last)) * step >= 10.0**p), 0)
    digits = max(0, -math.floor(math.log10(step) - power + 1e-9))
    if step / 10.0**power * 10.0**digits % 1.0 > 1e-6:  # a quarter
        digits += 1
    for number in range(first, last + 1):
        value = number * step
        yield value, f"{value / 10.0**power:z.{digits}f}{_PREFIXES[power] if number else ''}"


def _powers(low: float, high: float) -> Iterator[tuple[float, str]]:
    """Powers of ten between two numbers."""
    for power in range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1):
        yield 10.0**power, f"{10.0**power:g}"


def _axes(across: _Scale, up: _Scale, font: float) -> Iterator[str]:
    """The grid, the ends' lines and the ticks' words."""
    (left, right), (bottom, top) = across.ends, up.ends
    for value, word in across.ticks:
        place = float(across(np.array(value)))
        yield _segment(place, bottom, place, top, _GRID)
        yield _word(place, bottom + 1.2 * font, word, font)
    for value, word in up.ticks:
        place = float(up(np.array(value)))
        yield _segment(left, place, right, place, _GRID)
        yield _word(left - 0.4 * font, place + 0.35 * font, word, font, "end")
    yield _segment(left, bottom, right, bottom, _INK)
    yield _segment(left, bottom, left, top, _INK)


def _drawn(mark: Mark, across: _Scale, up: _Scale) -> str:
    if isinstance(mark, Bars):
        x, foot = across(mark.edges), up.ends[0]
        tops = np.where(mark.heights > 0, up(np.maximum(mark.heights, 1e-300)), foot)
        outline = np.repeat(x, 2), np.concatenate([[foot], np.repeat(tops, 2), [foot]])
        return f'<path d="{_path(*outline)}" fill="{mark.colour}" fill-opacity=".8"/>'
    x = across(mark.x)
    if isinstance(mark, Band):
        runs = _runs(np.isfinite(x) & np.isfinite(mark.low) & np.isfinite(mark.high))
        low, high = up(mark.low), up(mark.high)
        areas = "".join(
            _path(np.concatenate([x[r], x[r][::-1]]), np.concatenate([low[r], high[r][::-1]])) + "z"
            for r in runs
        )
        return f'<path d="{areas}" fill="{mark.colour}" fill-opacity=".2"/>'
    return _stroke(x, up(mark.y), mark)


def _stroke(x: np.ndarray, y: np.ndarray, mark: Line | Dots) -> str:
    """Points in pixels as a line, or as dots of a line's width."""
    if isinstance(mark, Dots):
        is_shown = np.isfinite(x) & np.isfinite(y)
        each = zip(x[is_shown], y[is_shown], strict=True)
        points = "".join(f"M{_at(a)} {_at(b)}h0" for a, b in each)
        form = f'stroke-width="{_at(mark.size)}" stroke-linecap="round" stroke-opacity=".5"'
    else:
        points = "".join(_path(x[run], y[run]) for run in _runs(np.isfinite(x) & np.isfinite(y)))
        form = f'stroke-width="{_at(mark.width)}" stroke-linejoin="round"'
        if mark.is_dashed:
            form += f' stroke-dasharray="{_at(4.0)} {_at(3.0)}"'
    return f'<path d="{points}" fill="none" stroke="{mark.colour}" {form}/>'


def steps(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of a line that holds each value until the next one [N] -> [2 N - 1]."""
    return np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]


def _runs(is_there: np.ndarray) -> Iterator[slice]:
    """Where values follow each other without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_there, [False]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(first), int(last))


def _path(x: np.ndarray, y: np.ndarray) -> str:
    if not len(x):
        return ""
    places = np.rint(_UNITS * np.stack([x, y], axis=1)).astype(int)
    return "M" + ("%d %d " * len(places)) % tuple(places.ravel().tolist())


def _segment(x0: float, y0: float, x1: float, y1: float, colour: str) -> str:
    ends = f"M{_at(x0)} {_at(y0)}L{_at(x1)} {_at(y1)}"
    return f'<path d="{ends}" stroke="{colour}" stroke-width="{_UNITS}"/>'


def _word(
    x: float, y: float, word: str, size: float, anchor: str = "middle", more: str = ""
) -> str:
    place = f'x="{_at(x)}" y="{_at(y)}" text-anchor="{anchor}"'
    return f'<text {place} font-size="{_at(size)}" fill="{_INK}"{more}>{escape(word)}</text>'


def _at(pixels: float) -> int:
    return round(_UNITS * pixels)
