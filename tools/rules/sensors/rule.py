"""A Bayes filter of each component's wear: inspects in doubt, and replaces what is worn.

Neighbours on a line are replaced together, since the line stands anyway.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np


class Component(NamedTuple):
    """Its chance to wear by a level in a step, and its wear at first."""

    rate: float
    wear: int


COMPONENTS = {
    "c1": Component(0.3, 0),
    "c2": Component(0.2, 1),
    "c3": Component(0.14, 2),
    "c4": Component(0.26, 0),
    "c5": Component(0.22, 1),
    "c6": Component(0.16, 2),
}
LINES = (("c1", "c2", "c3"), ("c4", "c5", "c6"))
ALARM = np.array([0.05, 0.15, 0.25, 0.35, 0.45, 0.85])
"""Chance of an alarm at each level of wear."""
LEVELS = np.eye(len(ALARM))
"""The beliefs that are sure of a level."""
HORIZON = 80
FAILED, RISK = 0.5, 0.08
"""Chance to have failed, or to fail in the next step, above which a component is replaced."""
JOIN, LOOK = 0.01, 0.08
"""Chance of either above which it is replaced with another of its line, or inspected."""
LAST_REPLACED, LAST_JOINED, LAST_INSPECTED = 3, 8, 4
"""Steps left up to which nothing of that is done any more."""


class Belief:
    """The probability of each level of wear of each component."""

    def __init__(self) -> None:
        """As at the beginning of an episode."""
        self.reset()

    def reset(self) -> None:
        """Begins an episode, whose components' wear is known."""
        self.replaced: frozenset[str] = frozenset()
        self._wear = {name: LEVELS[part.wear] for name, part in COMPONENTS.items()}

    def observe(self, state: Mapping[str, Any]) -> None:
        """Predicts a step and takes in what it shows."""
        for name, part in COMPONENTS.items():
            wear = LEVELS[0] if name in self.replaced else worn(self._wear[name], part.rate)
            alarm, reading = state[f"alarm___{name}"], state[f"reading___{name}"]
            if alarm is not None:
                wear = wear * (ALARM if alarm else 1 - ALARM)
                if int(reading) >= 0:
                    wear = LEVELS[int(reading)]
            self._wear[name] = wear / wear.sum()

    def failed(self, name: str) -> float:
        """The probability that a component has failed."""
        return self._wear[name][-1]

    def fails(self, name: str) -> float:
        """The probability that it fails in the next step."""
        return self._wear[name][-2] * COMPONENTS[name].rate


def worn(wear: np.ndarray, rate: float) -> np.ndarray:
    """A belief [6] after a step of wear."""
    up = np.append(wear[:-1] * rate, 0.0)
    return wear - up + np.roll(up, 1)


belief = Belief()


def line_actions(line: tuple[str, ...], left: int) -> dict[str, Any]:
    """What is replaced or inspected in a line.

    Args:
      line: its components.
      left: steps to the end.
    """
    out = {name for name in line if belief.failed(name) > FAILED or belief.fails(name) > RISK}
    doubt = {name: belief.fails(name) + belief.failed(name) for name in line}
    if out and left > LAST_REPLACED:
        if left > LAST_JOINED:
            out |= {name for name in line if doubt[name] > JOIN}
        return {f"replace___{name}": True for name in line if name in out}
    if left > LAST_INSPECTED:
        return {f"inspect___{name}": True for name in line if doubt[name] > LOOK}
    return {}


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """What is replaced and inspected."""
    if step == 0:
        belief.reset()
    else:
        belief.observe(state)
    actions: dict[str, Any] = {}
    for line in LINES:
        actions.update(line_actions(line, HORIZON - step))
    belief.replaced = frozenset(name for name in COMPONENTS if f"replace___{name}" in actions)
    return actions
