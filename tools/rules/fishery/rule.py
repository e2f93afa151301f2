"""Fishes each stock down to its target where that pays, and down to its limit in the last step."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple


class Species(NamedTuple):
    """The stock to leave, the one that is penalised below, the price, and the cost of effort."""

    target: float
    limit: float
    price: float
    cost: float


SPECIES = {
    "shrimp": Species(50.0, 15.0, 1.0, 6.0),
    "herring": Species(55.0, 15.0, 0.8, 6.0),
    "sprat": Species(50.0, 10.0, 0.5, 5.0),
    "cod": Species(7.2, 6.0, 5.0, 10.0),
    "tuna": Species(5.9, 5.0, 8.0, 15.0),
}
CATCHABILITY, LAST = 0.8, 59
"""Log share of a stock that full effort catches, and the last step."""
MARGIN = 0.05
"""Above the limit."""


def goal(species: Species, step: int) -> float:
    """What is to be left of a stock: in the end no less than pays, or than is allowed."""
    if step < LAST:
        return species.target
    return max(species.limit + MARGIN, species.cost / (CATCHABILITY * species.price))


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """The effort for each species."""
    actions = {}
    for name, species in SPECIES.items():
        stock = float(state[f"stock___{name}"])
        surplus = math.log(max(stock, 1e-6) / goal(species, step))
        effort = min(1.0, max(0.0, surplus / CATCHABILITY))
        caught = stock * (1 - math.exp(-CATCHABILITY * effort))
        if species.price * caught > species.cost * effort:
            actions[f"effort___{name}"] = effort
    return actions
