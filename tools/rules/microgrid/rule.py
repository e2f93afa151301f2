"""Unit commitment over the eight choices of generators: serves this hour, and prepares the next.

The energy in the battery is valued by how full it is.
"""

from collections.abc import Collection, Mapping
from itertools import product
from typing import Any, NamedTuple


class Generator(NamedTuple):
    """Least and most kW; costs of an hour on, of a kWh and of a start."""

    low: float
    high: float
    idle: float
    fuel: float
    start: float


class Dispatch(NamedTuple):
    """The cost of an hour, the set points, and the battery's power, negative if it charges."""

    cost: float
    power: dict[str, float]
    battery: float


class Forecast(NamedTuple):
    """Load less wind and sun: in this hour, the next, and the one after it."""

    now: float
    after: float
    later: float


GENERATORS = {
    "g1": Generator(40.0, 100.0, 5.0, 0.2, 25.0),
    "g2": Generator(30.0, 80.0, 4.0, 0.24, 15.0),
    "g3": Generator(10.0, 40.0, 2.0, 0.34, 5.0),
}
LOAD = (
    *(85, 78, 74, 72, 76, 90, 120, 155, 170, 165, 158, 160),
    *(165, 158, 150, 152, 165, 190, 215, 220, 200, 165, 130, 100),
)
SUN = (
    *(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 22.7, 44.1, 63.0, 78.2, 88.8),
    *(94.3, 94.3, 88.8, 78.2, 63.0, 44.1, 22.7, 0.0, 0.0, 0.0, 0.0, 0.0),
)
SHARE = {"clear": 1.0, "broken": 0.55, "dull": 0.2}
NEXT_SHARE = {"clear": 0.9, "broken": 0.57, "dull": 0.31}
"""Of the sun that comes through: now, and as expected for the next hour."""
WIND, SWING_KEPT = 40.0, 0.7
"""Mean of the wind in kW, and what stays of the swing of the load."""
CAPACITY, POWER, KEPT, WEAR = 120.0, 50.0, 0.88, 0.02
OUTAGE, SPILL = 6.0, 0.02
RESERVE, AHEAD = 40.0, 0.5
"""The next hour needs as much more or less; weight of each of these cases."""
SPREAD, SHORT = 0.6, 0.3
"""Share of the stored energy for the hour after the next; cost of a kW short in it."""
FULL, EMPTY, LAST_VALUE = 0.19, 0.42, 0.15
"""Value of a stored kWh in a full battery, in an empty one, and at the end."""
STOP = 0.8
"""Cost of a stop, in starts."""
END, LAST_HOURS = 71, 66
"""The last hour, and the one from which on stored energy loses its value."""


def dispatch(units: Collection[str], need: float, energy: float, value: float) -> Dispatch:
    """Serves an hour by the cheapest of the generators on and the battery.

    Args:
      units: the generators on.
      need: kW.
      energy: kWh in the battery.
      value: of a kWh in the battery.
    """
    power = {name: GENERATORS[name].low for name in units}
    left, battery = need - sum(power.values()), 0.0
    room = min(POWER, (CAPACITY - energy) / KEPT)
    offers = [(GENERATORS[name].fuel, name) for name in units]
    for price, name in sorted([*offers, (value + WEAR, "battery")]):
        if name == "battery":
            battery = max(0.0, min(min(POWER, energy), left))
            left -= battery
        else:
            # one that costs less than what stored energy is worth fills the battery too
            goal = left + (room if price < value * KEPT and left >= 0 else 0.0)
            more = max(0.0, min(GENERATORS[name].high - power[name], goal))
            power[name] += more
            left -= more
    if left < 0 and battery == 0:
        battery = max(left, -room)
        left -= battery
    cost = sum(GENERATORS[name].idle + GENERATORS[name].fuel * power[name] for name in units)
    cost += OUTAGE * max(0.0, left) + SPILL * max(0.0, -left)
    cost += (value + WEAR) * battery if battery > 0 else value * KEPT * battery
    return Dispatch(cost, power, battery)


def forecast(state: Mapping[str, Any]) -> Forecast:
    """What the generators and the battery are to serve."""
    hour, sky = int(str(state["clock"]).strip("@h")), str(state["weather"]).strip("@")
    wind, swing = float(state["wind"]), float(state["swing"])
    following, third = (hour + 1) % 24, (hour + 2) % 24
    sun = NEXT_SHARE[sky]
    after = LOAD[following] * (1 + SWING_KEPT * swing) - (WIND + 0.85 * (wind - WIND))
    return Forecast(
        now=LOAD[hour] * (1 + swing) - wind - SUN[hour] * SHARE[sky],
        after=after - SUN[following] * sun,
        later=LOAD[third] - (WIND + 0.7 * (wind - WIND)) - SUN[third] * sun,
    )


def switching_cost(run: Collection[str], on: Collection[str]) -> float:
    """The cost of starts, with the hour of idling that they take, and of stops."""
    starts = [GENERATORS[name] for name in run if name not in on]
    stops = [GENERATORS[name] for name in on if name not in run]
    started = sum(generator.idle + generator.start for generator in starts)
    return started + sum(generator.start * STOP for generator in stops)


def cost_ahead(run: Collection[str], need: Forecast, energy: float, value: float) -> float:
    """The expected cost of the hours to come with the generators that run.

    The arguments are those of `dispatch`, with the energy after this hour.
    """
    cases = (need.after + RESERVE, need.after - RESERVE)
    cost = AHEAD * sum(dispatch(run, case, energy, value).cost for case in cases)
    short = need.later - sum(GENERATORS[name].high for name in run) - SPREAD * energy
    return cost + SHORT * max(0.0, short)


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """Which generators run, their set points, and the battery's power."""
    on = [name for name in GENERATORS if state[f"on___{name}"]]
    need, energy = forecast(state), float(state["soc"])
    value = FULL + (EMPTY - FULL) * (1 - energy / CAPACITY) if step < LAST_HOURS else LAST_VALUE
    choices = []
    for picked in product([False, True], repeat=len(GENERATORS)):
        run = [name for name, is_run in zip(GENERATORS, picked, strict=True) if is_run]
        now = dispatch([name for name in run if name in on], need.now, energy, value)
        cost = now.cost + switching_cost(run, on)
        if step < END:
            left = energy - max(now.battery, 0.0) + KEPT * max(-now.battery, 0.0)
            cost += cost_ahead(run, need, left, value)
        choices.append((cost, run, now))
    _, run, now = min(choices, key=lambda choice: choice[0])
    actions: dict[str, Any] = {f"run___{name}": True for name in run}
    actions |= {f"power___{name}": float(power) for name, power in now.power.items()}
    return {**actions, "battery": float(max(-POWER, min(POWER, now.battery)))}
