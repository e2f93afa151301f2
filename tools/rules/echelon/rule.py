"""An (s, S) rule on the inventory position: stock and orders on the road, less the backlog.

The levels follow the demand of the next days; a warehouse and the factory count what lies below.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple


class Levels(NamedTuple):
    """Days of demand below which a place orders and up to which, and when it stops ordering.

    Attributes:
      low: days.
      up: days.
      last: days left from which on nothing is ordered.
    """

    low: float
    up: float
    last: int


DEMAND = {"s1": 4.0, "s2": 6.0, "s3": 2.5, "s4": 5.0, "s5": 3.0}
BELOW = {"w1": ("s1", "s2", "s3"), "w2": ("s4", "s5")}
FACTORY = "f"
MAX_ORDER = {"f": 60, "w1": 80, "w2": 60, **dict.fromkeys(DEMAND, 40)}
SHOP, WAREHOUSE, MAKER = Levels(3.0, 6.5, 2), Levels(5.0, 10.0, 4), Levels(9.0, 14.0, 7)
SAFETY = 1.36
"""Safety stock of a shop, in roots of its demand."""
WEEKEND = 1.7
HORIZON = 63


class Orders:
    """The orders of a day, placed one after another."""

    def __init__(self, state: Mapping[str, Any], step: int) -> None:
        """Nothing is ordered yet."""
        self._state, self._left = state, HORIZON - step
        self._day = int(state["day"])
        self.position = {p: self._position(p) for p in (*DEMAND, *BELOW, FACTORY)}
        self.placed: dict[str, int] = {}

    def at_hand(self, place: str) -> int:
        """What a place can send today."""
        return self._number("stock", place) + self._number("coming1", place)

    def place(
        self, place: str, echelon: tuple[str, ...], levels: Levels, have: float, safety: float = 0.0
    ) -> int:
        """Orders what a place lacks, and returns how much.

        Args:
          place: who orders.
          echelon: the places whose positions count.
          levels: when to order, and how much.
          have: what its supplier has.
          safety: stock on top of the levels.
        """
        position = sum(self.position[p] for p in echelon)
        demand = sum(DEMAND.get(p, 0.0) for p in echelon)
        low, up = (demand * self._days(days) + safety for days in (levels.low, levels.up))
        if position >= low or self._left <= levels.last or have <= 0:
            return 0
        wanted = round(min(up - position, have))
        amount = max(0, min(MAX_ORDER[place], wanted))
        if amount:
            self.placed[f"order___{place}"] = amount
        return amount

    def _position(self, place: str) -> int:
        coming = self.at_hand(place) + self._number("coming2", place)
        return coming - self._number("backlog", place)

    def _number(self, fluent: str, place: str) -> int:
        return int(self._state[f"{fluent}___{place}"])

    def _days(self, days: float) -> float:
        """The demand of the next days, until the end, in units of a weekday's mean."""
        days = min(self._left, days)
        full = int(days)
        factors = [WEEKEND if (self._day + ahead) % 7 >= 5 else 1.0 for ahead in range(full + 1)]
        return sum(factors[:full]) + (days - full) * factors[full]


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """The orders: of shops, the shortest of stock first, of warehouses, of the factory."""
    orders = Orders(state, step)
    for warehouse, shops in BELOW.items():
        have = orders.at_hand(warehouse)
        for shop in sorted(shops, key=lambda shop: orders.position[shop] / DEMAND[shop]):
            safety = SAFETY * math.sqrt(DEMAND[shop])
            have -= orders.place(shop, (shop,), SHOP, have, safety)
    have = orders.at_hand(FACTORY)
    for warehouse, shops in BELOW.items():
        have -= orders.place(warehouse, (warehouse, *shops), WAREHOUSE, have)
    orders.place(FACTORY, tuple(orders.position), MAKER, math.inf)
    return orders.placed
