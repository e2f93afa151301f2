"""Ambulances that are or will soon be empty are assigned to calls at least cost.

Patients go to the nearest hospital, idle ambulances to posts.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

ROADS = (
    *((1, 2), (2, 3), (3, 4), (1, 5), (2, 6), (3, 7), (4, 8), (5, 6), (6, 7), (7, 8)),
    *((5, 9), (6, 10), (8, 12), (9, 10), (10, 11), (11, 12)),
)
ZONES = range(1, 13)
HOSPITALS, POSTS = (2, 11), (6, 12, 9, 4, 2)
AMBULANCES = ("a1", "a2", "a3", "a4", "a5")
URGENCY = 0.4
"""How much more a call counts for each step that it has waited."""
BASE = 10.0
"""The distance that makes no call worth serving."""
_FAR = 99


def distances() -> np.ndarray:
    """Moves between the zones [13, 13]; zone 0 is none."""
    found = np.full((len(ZONES) + 1, len(ZONES) + 1), _FAR)
    np.fill_diagonal(found, 0)
    for first, second in ROADS:
        found[first, second] = found[second, first] = 1
    for zone in ZONES:
        found = np.minimum(found, found[:, zone : zone + 1] + found[zone : zone + 1, :])
    return found


DISTANCES = distances()


def next_zone(zone: int, target: int) -> int:
    """The zone to move to on a shortest way."""
    if zone == target:
        return zone
    neighbours = [other for other in ZONES if DISTANCES[zone, other] == 1]
    return min(neighbours, key=lambda other: DISTANCES[other, target])


def assigned(costs: Sequence[Sequence[float]]) -> list[tuple[int, int]]:
    """Pairs of a row and a column of least total cost."""
    rows, columns = linear_sum_assignment(np.array(costs))
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def call_cost(zone: int, hospital: int | None, call: int, wait: int) -> float:
    """The cost of sending an ambulance to a call.

    Args:
      zone: where the ambulance is.
      hospital: where it goes before, if it carries a patient.
      call: the zone of the call.
      wait: steps since the call came.
    """
    way = DISTANCES[zone, call]
    if hospital is not None:
        way = DISTANCES[hospital, call] + DISTANCES[zone, hospital]
    weight = 1 + URGENCY * wait
    return way * weight - BASE * weight


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """Where the ambulances go."""
    zones = {a: int(str(state[f"at___{a}"]).strip("@z")) for a in AMBULANCES}
    waits = {zone: int(state[f"wait___z{zone}"]) for zone in ZONES}
    calls = [zone for zone in ZONES if waits[zone] > 0]
    targets = {
        a: min(HOSPITALS, key=lambda hospital, zone=zones[a]: DISTANCES[zone, hospital])
        for a in AMBULANCES
        if state[f"carrying___{a}"]
    }
    if calls:
        costs = [
            [call_cost(zones[a], targets.get(a), call, waits[call]) for call in calls]
            for a in AMBULANCES
        ]
        for row, column in assigned(costs):
            # one that carries a patient comes later
            targets.setdefault(AMBULANCES[row], calls[column])
    idle = [a for a in AMBULANCES if a not in targets]
    if idle:
        posts = POSTS[: len(idle)]
        for row, column in assigned([[DISTANCES[zones[a], p] for p in posts] for a in idle]):
            targets[idle[row]] = posts[column]
    return {f"go___{a}": f"z{next_zone(zones[a], targets[a])}" for a in AMBULANCES}
