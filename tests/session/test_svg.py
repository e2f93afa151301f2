"""The page's charts: what a number becomes, and what stands at the axes."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from mdpo_rddl.session.report.page.svg import (
    Axis,
    Band,
    Bars,
    Dots,
    Layout,
    Line,
    chart,
    round_ticks,
    steps,
)

ANY = Axis()


def drawn(*marks, x=ANY, y=ANY, **more):
    return ElementTree.fromstring(str(chart(marks, x, y, "a <text>", **more).markup))


def words(svg):
    return [each.text for each in svg.iter("text")]


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0.0, 10.0, 5, ["0", "2", "4", "6", "8", "10"]),
        (-1.0, 1.0, 4, ["-1.0", "-0.5", "0.0", "0.5", "1.0"]),
        (0.0, 1.0, 4, ["0.00", "0.25", "0.50", "0.75", "1.00"]),
        (-2.1e6, 0.1e6, 5, ["-2.0M", "-1.5M", "-1.0M", "-0.5M", "0.0"]),
        (12_000.0, 18_000.0, 3, ["12k", "14k", "16k", "18k"]),
        (0.0, 3e-5, 3, ["0.00000", "0.00001", "0.00002", "0.00003"]),
    ],
)
def test_ticks_are_round_numbers(low, high, most, expected):
    found = list(round_ticks(low, high, most))
    assert [word for _, word in found] == expected
    assert all(low <= value + 1e-9 and value - 1e-9 <= high for value, _ in found)


def test_a_line_goes_from_corner_to_corner_and_has_a_gap_where_a_number_is_missing():
    ends = Axis(low=0.0, high=4.0, ticks={})
    line = Line(np.arange(5.0), np.array([0.0, 1.0, np.nan, 3.0, 4.0]), "red")
    svg = drawn(line, x=ends, y=ends, layout=Layout(100.0, 79.0, 8.0))
    (path,) = [each for each in svg.iter("path") if each.get("stroke") == "red"]
    numbers = [[int(n) for n in part.split()] for part in path.get("d").split("M")[1:]]
    # a tenth of a pixel: 8 pixels of room on either side, 6 above and 15 below
    assert numbers == [[80, 640, 290, 495], [710, 205, 920, 60]]


def test_infinite_numbers_are_the_ends_of_the_axis_and_dots_are_points():
    svg = drawn(
        Line(np.zeros(2), np.array([-np.inf, np.inf]), "red"),
        Dots(np.array([0.0, np.nan, 1.0]), np.zeros(3), "blue"),
        y=Axis(low=-1.0, high=1.0),
    )
    line, dots = (
        next(each.get("d") for each in svg.iter("path") if each.get("stroke") == colour)
        for colour in ("red", "blue")
    )
    assert re.fullmatch(r"M\d+ \d+ \d+ \d+ ", line)
    assert dots.count("h0") == 2


def test_steps_hold_a_value_until_the_next():
    x, y = steps(np.array([0.0, 1.0, 3.0]), np.array([5.0, 6.0, 7.0]))
    assert x.tolist() == [0.0, 1.0, 1.0, 3.0, 3.0]
    assert y.tolist() == [5.0, 5.0, 6.0, 6.0, 7.0]


def test_names_and_texts_are_escaped():
    line = Line(np.arange(2.0), np.arange(2.0), "red", label="<b> & $x$")
    svg = drawn(line, x=Axis("a<b"), y=Axis(ticks={0.5: "<half>"}), title="<title>")
    assert svg.get("aria-label") == "a <text>"
    assert {"<b> & $x$", "a<b", "<half>", "<title>"} <= set(words(svg))


@pytest.mark.parametrize("values", [[], [3.0], [np.nan], [7.0, 7.0 + 1e-12], [-1e30, 1e30]])
@pytest.mark.filterwarnings("error")
def test_few_or_large_numbers_have_a_chart(values):
    values = np.array(values)
    places = np.arange(float(len(values)))
    marks = (
        Line(places, values, "red"),
        Band(places, values, values, "red"),
        Dots(places, values, "k"),
    )
    assert words(drawn(*marks))


def test_powers_of_ten_stand_at_a_logarithmic_axis():
    bars = Bars(np.geomspace(0.05, 200.0, 5), np.array([1, 0, 5, 2]), "red")
    found = words(drawn(bars, x=Axis(is_log=True), y=Axis(low=0.5, is_log=True)))
    assert found == ["0.1", "1", "10", "100", "1"]


def test_numbers_without_a_finite_range_are_refused():
    with pytest.raises(ValueError, match="too large to be drawn"):
        drawn(Dots(np.zeros(2), np.array([-1e308, 1e308]), "red"))
