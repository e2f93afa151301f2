"""Each satellite in turn takes the free target that is worth most for the steps it takes.

The worth is the age on arrival times the chance of a clear sky.
"""

from collections.abc import Mapping
from math import hypot
from typing import Any, NamedTuple


class Target(NamedTuple):
    """Where a target is, what it is worth, and how often a cloud comes and leaves."""

    lon: float
    lat: float
    worth: float
    comes: float
    leaves: float


TARGETS = {
    "t1": Target(0, 50, 1.0, 0.15, 0.1),
    "t2": Target(12, 42, 0.8, 0.1, 0.15),
    "t3": Target(30, 30, 1.5, 0.03, 0.4),
    "t4": Target(-20, 60, 2.0, 0.2, 0.1),
    "t5": Target(55, 25, 0.6, 0.02, 0.5),
    "t6": Target(20, -5, 1.8, 0.2, 0.2),
    "t7": Target(40, 55, 1.0, 0.1, 0.15),
    "t8": Target(-10, 10, 1.2, 0.08, 0.2),
    "t9": Target(70, 45, 1.6, 0.1, 0.15),
    "t10": Target(-40, 35, 0.9, 0.1, 0.15),
}
TURN = {"a": 15.0, "b": 22.0, "c": 10.0}
"""Degrees in a step."""
SLEW, SHOT, RESERVE = 0.05, 0.8, 1.0
"""Energy of a degree, of a picture, and what is left after turning."""
POWER = 1.3
"""Of the steps, by which the worth is divided."""
MAX_AGE, HORIZON = 30, 80


def worth(state: Mapping[str, Any], name: str, wait: int) -> float:
    """The worth of a target for a satellite that looks at it after some steps."""
    target = TARGETS[name]
    changes = target.comes + target.leaves
    clear, now = target.leaves / changes, 0.0 if state[f"cloud___{name}"] else 1.0
    chance = clear + (now - clear) * (1 - target.comes - target.leaves) ** wait
    age = min(MAX_AGE, state[f"age___{name}"] + wait)
    return chance * target.worth * age / (wait + 1) ** POWER


def options(state: Mapping[str, Any], step: int, satellite: str, aim: str) -> dict[str, float]:
    """The worth of each target that a satellite can look at, from the one it looks at now."""
    found, here = {}, TARGETS[aim]
    for name, target in TARGETS.items():
        angle, is_other = hypot(target.lon - here.lon, target.lat - here.lat), name != aim
        wait = 1 + round(angle / TURN[satellite]) if is_other else 0
        needed = SLEW * angle + SHOT + RESERVE * is_other
        if step + wait < HORIZON and needed <= state[f"energy___{satellite}"]:
            found[name] = worth(state, name, wait)
    return found


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """Where the satellites point."""
    aim = {satellite: state[f"aim___{satellite}"].lstrip("@") for satellite in TURN}
    busy = {satellite for satellite in TURN if state[f"togo___{satellite}"] > 0}
    taken = {aim[satellite] for satellite in busy}
    ranked = sorted(
        (
            (value, satellite, name)
            for satellite in TURN
            if satellite not in busy
            for name, value in options(state, step, satellite, aim[satellite]).items()
        ),
        reverse=True,
    )
    for _, satellite, name in ranked:
        if satellite not in busy and name not in taken:
            busy.add(satellite)
            taken.add(name)
            aim[satellite] = name
    return {f"point___{satellite}": name for satellite, name in aim.items()}
