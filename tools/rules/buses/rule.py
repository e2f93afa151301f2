"""Headway control: a bus waits at a stop while the bus ahead is nearer than the one behind."""

from collections.abc import Mapping
from typing import Any

LENGTH = (3.0, 4.0, 3.0, 2.0, 2.5, 3.0, 3.0, 4.5, 3.0, 2.0, 3.0, 3.5)
"""From each stop to the next."""
DWELL = 1.6
"""What a stop counts, in units of distance."""
BUSES = tuple(f"b{number}" for number in range(1, 7))
# places of the stops on the ring, and where it ends
STOPS = tuple(sum(LENGTH[:number]) + number * DWELL for number in range(13))
RING = STOPS[12]
HEADWAY = RING / len(BUSES)
SLACK, LONGEST, FULL = 0.5, 6, 40


class Waits:
    """For how many steps each bus has been held at its stop."""

    def __init__(self) -> None:
        """No bus has been held."""
        self.reset()

    def reset(self) -> None:
        """Begins an episode."""
        self.steps = dict.fromkeys(BUSES, 0)


waits = Waits()


def place(state: Mapping[str, Any], bus: str) -> float:
    """Where a bus is on the ring."""
    stop = int(state[f"at___{bus}"].lstrip("@s")) - 1
    return (STOPS[stop] - float(state[f"dist___{bus}"])) % RING


def gap(places: Mapping[str, float], behind: str, ahead: str) -> float:
    """The way from one bus to another; in the same place the first of `BUSES` is behind."""
    way = (places[ahead] - places[behind]) % RING
    return way or (RING if BUSES.index(ahead) > BUSES.index(behind) else 0.0)


def is_early(places: Mapping[str, float], bus: str) -> bool:
    """Whether a bus is nearer to the one ahead than to the one behind."""
    others = [other for other in BUSES if other != bus]
    ahead = min(gap(places, bus, other) for other in others)
    behind = min(gap(places, other, bus) for other in others)
    return min(ahead, HEADWAY) - SLACK < min(behind, HEADWAY)


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """The buses that are held."""
    if step == 0:
        waits.reset()
    places = {bus: place(state, bus) for bus in BUSES}
    actions = {}
    for bus in BUSES:
        if state[f"dist___{bus}"] > 0:
            waits.steps[bus] = 0
        elif is_early(places, bus) and waits.steps[bus] < LONGEST and state[f"load___{bus}"] < FULL:
            actions[f"hold___{bus}"] = True
            waits.steps[bus] += 1
    return actions
