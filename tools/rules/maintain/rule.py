"""Repairs the machines whose wear costs most: lost output and the risk of a breakdown."""

from collections.abc import Mapping
from typing import Any

FLOW = {
    **{"m1": 4, "m2": 4, "m3": 4, "m4": 6, "m5": 6},
    **{"m6": 3.6, "m7": 4.8, "m8": 3.6, "m9": 6, "m10": 6},
}
"""Units that pass through a machine in a step."""
WEAR = {
    **{"m1": 0.12, "m2": 0.16, "m3": 0.2, "m4": 0.14, "m5": 0.2},
    **{"m6": 0.1, "m7": 0.22, "m8": 0.16, "m9": 0.12, "m10": 0.18},
}
SOURCES = ("m1", "m2", "m3")
LOST = {0: 1.0, 1: 0.63, 2: 0.41, 3: 0.19}
"""Share of its output that a machine lacks, by its condition; better ones are not repaired."""
RISK = {1: 48.0, 2: 14.35, 3: 2.0}
"""Cost of what may break, by condition, per unit of wear."""
FIX, FIX_BROKEN = 0.6, 0.3
HORIZON, CREW = 80, 2
LAST_STEPS = 3
"""In which nothing is repaired."""
AHEAD, PER_STEP = 8, 0.35
"""Steps in which a repair counts, and what one of them counts."""
LEAST = 1.8
"""What a repair must bring."""


def gain(state: Mapping[str, Any], machine: str, left: int) -> float:
    """What a step of repair is expected to bring.

    Args:
      state: of the factory.
      machine: its name; its condition is in `LOST`.
      left: steps to the end.
    """
    condition = int(state[f"cond___{machine}"])
    lost = LOST[condition] * FLOW[machine]
    is_fed = machine in SOURCES or state[f"buffer___{machine}"] > 2.0
    output = lost * (1.0 if is_fed else 0.7) * min(left, AHEAD) * PER_STEP
    chance = FIX if condition else FIX_BROKEN
    return chance * (output + RISK.get(condition, 0.0) * WEAR[machine])


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """The machines that are repaired."""
    left = HORIZON - step
    if left < LAST_STEPS:
        return {}
    worn = [machine for machine in FLOW if int(state[f"cond___{machine}"]) in LOST]
    gains = {machine: gain(state, machine, left) for machine in worn}
    worth = [machine for machine in worn if gains[machine] > LEAST]
    best = sorted(worth, key=lambda machine: -gains[machine])[:CREW]
    return {f"repair___{machine}": True for machine in best}
