"""How the table writes numbers."""

import io

import pytest
from rich.console import Console

from mdpo_rddl.cli.display import print_summary

SUMMARY = {
    "label": "two",
    "horizon": 7,
    "policy": "feedback",
    "noise": "none",
    "noise_parameters": {},
    "seed": 0,
    "episodes": 1,
    "returns": [0.0],
    "ci95": None,
    "std_return": 0.0,
    "illegal_actions": 0,
    "fallback_actions": 0,
}


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (-0.0, "0.00"),
        (-0.001, "0.00"),
        (-0.01, "-0.01"),
        (-1234.5, "-1,234.50"),
        (3.4028e38, "3.4028e+38"),
        (None, "not finite"),
    ],
)
def test_a_return_as_it_is_shown(value, shown):
    text = io.StringIO()
    print_summary(Console(file=text, width=80), {**SUMMARY, "mean_return": value}, None)
    (line,) = [line for line in text.getvalue().splitlines() if "mean return" in line]
    assert line.split("│")[2].strip() == shown
