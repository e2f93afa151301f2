"""Batteries charge in the cheapest of the next hours and discharge in the dearest.

Prices are forecast; the difference must pay for losses and wear.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple


class Battery(NamedTuple):
    """One battery: kWh, kW, efficiency one way, and cents of wear per kWh moved."""

    capacity: float
    power: float
    efficiency: float
    wear: float


# the largest first
BATTERIES = {
    "b3": Battery(24.0, 6.0, 0.92, 0.4),
    "b1": Battery(14.0, 5.0, 0.95, 0.8),
    "b2": Battery(10.0, 4.0, 0.93, 0.6),
    "b4": Battery(6.0, 3.0, 0.97, 1.2),
}
AHEAD, END = 8, 72
"""Hours of the forecast, and of the episode."""
PERSISTENCE = 0.8
"""Of the deviation of the price."""
SELL, GRID, EXPORT = 0.8, 15.0, 9.0
PEAK_SHARE = 0.8
"""Mean of what is paid later for stored energy, as a share of the peak's price."""
LAST_HOURS = 8
"""In which nothing is bought again."""
SURPLUS = 0.5
"""kW from which on solar power, or load, counts."""


@dataclass
class Hour:
    """What an hour offers, of which each battery in turn takes a part.

    Attributes:
      price: in cents per kWh.
      future: forecast prices of the next hours.
      is_late: whether energy is bought no more.
      room: kW that may still be charged.
      outlet: kW that may still be discharged.
      surplus: kW of the sun that nobody uses.
      load: kW that nobody serves.
    """

    price: float
    future: list[float]
    is_late: bool
    room: float
    outlet: float
    surplus: float
    load: float


def hour_of(state: Mapping[str, Any]) -> Hour:
    """What the hour offers before any battery acts."""
    t, net = state["t"], state["load"] - state["pv"]
    steps = range(1, min(AHEAD, END - 1 - t) + 1)
    return Hour(
        price=state["price"],
        future=[mean_price(t + k) + state["dev"] * PERSISTENCE**k for k in steps],
        is_late=t >= END - LAST_HOURS,
        room=max(0.0, GRID - net),
        outlet=max(0.0, net + EXPORT),
        surplus=max(0.0, -net),
        load=max(0.0, net),
    )


def mean_price(t: int) -> float:
    """The expected price of an hour."""
    w = 2 * math.pi / 24
    return 22 + 5 * math.cos(w * (t - 19)) + 6 * math.cos(2 * w * (t - 8))


def is_to_charge(battery: Battery, energy: float, hour: Hour) -> bool:
    """Whether this is one of the cheapest hours before the peak, and the peak pays for it."""
    per_hour = battery.power * battery.efficiency
    hours = math.ceil((battery.capacity - energy) / per_hour - 0.05)
    cost = hour.price * (SELL if hour.surplus > SURPLUS else 1.0)
    twice = battery.efficiency * battery.efficiency
    top = max(hour.future, default=0.0)
    gain = top * PEAK_SHARE * twice - cost - battery.wear * (1 + twice)
    peak = hour.future.index(top) if hour.future else 0
    cheaper = sum(price < hour.price for price in hour.future[:peak])
    return hours > 0 and gain > 0 and cheaper < hours


def is_to_discharge(battery: Battery, energy: float, hour: Hour) -> bool:
    """Whether this is one of the dearest hours before the trough, and pays for refilling."""
    hours = math.ceil(energy * battery.efficiency / battery.power - 0.05)
    price = hour.price * (1.0 if hour.load > SURPLUS else SELL)
    worth = price * battery.efficiency - battery.wear * battery.efficiency
    bottom = min(hour.future, default=0.0)
    trough = hour.future.index(bottom) if hour.future else 0
    dearer = sum(price > hour.price for price in hour.future[:trough])
    is_refilled = hour.future and not hour.is_late
    refill = bottom / battery.efficiency + battery.wear if is_refilled else 0.0
    return energy > 0.1 and dearer < hours and worth > refill


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """What each battery charges or discharges."""
    actions, hour = {}, hour_of(state)
    for name, battery in BATTERIES.items():
        energy = state[f"soc___{name}"]
        if is_to_charge(battery, energy, hour):
            room = (battery.capacity - energy) / battery.efficiency
            amount = min(battery.power, room, hour.room)
            actions[f"charge___{name}"] = amount
            hour.room -= amount
            hour.surplus -= amount
        elif is_to_discharge(battery, energy, hour):
            amount = min(battery.power, energy * battery.efficiency, hour.outlet)
            if amount > 0:
                actions[f"discharge___{name}"] = amount
                hour.outlet -= amount
                hour.load -= amount
    return actions
