"""Vaccinates where a vaccination prevents most, and locks down regions where many fall ill."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Region(NamedTuple):
    """Thousands of people, infections by an ill person in a step, and vaccinations in a step."""

    people: float
    rate: float
    most: float


REGIONS = {
    "r1": Region(800.0, 0.6, 20.0),
    "r2": Region(500.0, 0.55, 20.0),
    "r3": Region(300.0, 0.55, 20.0),
    "r4": Region(250.0, 0.5, 20.0),
    "r5": Region(150.0, 0.45, 12.0),
    "r6": Region(100.0, 0.55, 10.0),
}
BUDGET, RECOVERY, HORIZON = 30.0, 0.25, 60
LEAST_SPREAD, IDLE_SPREAD = 0.8, 0.9
"""Reproduction number from which on to vaccinate, and the one that counts as none."""
ILLNESS = 20.0
"""How much more a vaccination counts where many are ill."""
LOCK_SHARE, LOCK_SPREAD, LAST_STEPS = 0.005, 1.4, 2
"""Share of ill people and reproduction number of a lockdown, and the last steps, without one."""


class Lockdowns:
    """The regions that are locked down."""

    def __init__(self) -> None:
        """All are open."""
        self.regions: set[str] = set()

    def reset(self) -> None:
        """Begins an episode."""
        self.regions.clear()


lockdowns = Lockdowns()


def reproduction(state: Mapping[str, Any], name: str) -> float:
    """People whom an ill person would infect if the region were open."""
    region = REGIONS[name]
    return state["strain"] * region.rate / RECOVERY * state[f"s___{name}"] / region.people


def urgency(state: Mapping[str, Any], name: str) -> float:
    """What a vaccination in a region counts."""
    susceptible = state[f"s___{name}"]
    hit = susceptible / (susceptible + 0.5 * state[f"r___{name}"])
    ill = state[f"i___{name}"] / REGIONS[name].people
    return (reproduction(state, name) - IDLE_SPREAD) * hit * (1 + ILLNESS * ill)


def vaccinations(state: Mapping[str, Any]) -> dict[str, float]:
    """What each region gets of the budget."""
    given, left = {}, BUDGET
    for name in sorted(REGIONS, key=lambda name: -urgency(state, name)):
        susceptible = state[f"s___{name}"]
        if reproduction(state, name) > LEAST_SPREAD and left > 0 and susceptible > 1.0:
            given[name] = min(left, REGIONS[name].most, susceptible)
            left -= given[name]
    return given


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """Vaccinations and lockdowns."""
    if step == 0:
        lockdowns.reset()
    actions: dict[str, Any] = {f"vaccinate___{k}": v for k, v in vaccinations(state).items()}
    for name, region in REGIONS.items():
        share, spread = state[f"i___{name}"] / region.people, reproduction(state, name)
        if share < LOCK_SHARE or spread < LOCK_SPREAD:
            lockdowns.regions.discard(name)
        elif share > LOCK_SHARE and spread > LOCK_SPREAD:
            lockdowns.regions.add(name)
        if name in lockdowns.regions and step < HORIZON - LAST_STEPS:
            actions[f"lockdown___{name}"] = True
    return actions
