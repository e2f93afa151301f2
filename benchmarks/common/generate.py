"""Instances of any size, for measuring how time and memory grow."""

from collections.abc import Iterable

import numpy as np

HORIZON = 120


def reservoir_instance(size: int, seed: int, horizon: int = HORIZON) -> str:
    """A network of reservoirs, for `domains/reservoir.rddl`.

    Each drains into one or two that come after it, the last one into the sea.

    Args:
      size: number of reservoirs.
      seed: of the network, the bands and the initial levels.
      horizon: of the instance.
    """
    random = np.random.default_rng(seed)
    names = [f"t{i + 1}" for i in range(size)]
    facts = [f"CONNECTED_TO_SEA({names[-1]})"]
    for i, name in enumerate(names[:-1]):
        later = random.choice(np.arange(i + 1, size), min(2, size - 1 - i), replace=False)
        facts += [f"RES_CONNECT({name}, {names[j]})" for j in sorted(later)]
    state = []
    for name in names:
        low, band, rim = random.uniform(20, 300), random.uniform(20, 100), random.uniform(20, 100)
        facts += [
            f"MIN_LEVEL({name}) = {low:.3f}",
            f"MAX_LEVEL({name}) = {low + band:.3f}",
            f"TOP_RES({name}) = {low + band + rim:.3f}",
            f"RAIN_VAR({name}) = 50.0",
        ]
        state.append(f"rlevel({name}) = {random.uniform(0, low + band):.3f}")
    return _instance("reservoir_control_cont", {"reservoir": names}, facts, state, horizon)


def hvac_instance(size: int, seed: int, horizon: int = HORIZON) -> str:
    """A building whose zones stand in a row, for `domains/hvac.rddl`.

    Each zone has a heater and walls to the next two zones; every third may empty.

    Args:
      size: number of zones.
      seed: of the initial temperatures.
      horizon: of the instance.
    """
    random = np.random.default_rng(seed)
    zones = [f"z{i + 1}" for i in range(size)]
    heaters = [f"h{i + 1}" for i in range(size)]
    facts = ["TEMP-ZONE-MIN = 22.0", "TEMP-ZONE-MAX = 25.0"]
    for i, (zone, heater) in enumerate(zip(zones, heaters, strict=True)):
        facts.append(f"ADJ-HEATER({heater}, {zone})")
        facts += [f"ADJ-ZONES({zone}, {other})" for other in zones[i + 1 : i + 3]]
        if i % 3 == 0:
            facts.append(f"P-SWITCH({zone}) = 0.02")
    state = [f"temp-zone({name}) = {random.uniform(2, 13):.3f}" for name in zones]
    state += [f"temp-heater({name}) = {random.uniform(1, 9):.3f}" for name in heaters]
    return _instance("hvac", {"zone": zones, "heater": heaters}, facts, state, horizon)


def _instance(
    domain: str,
    objects: dict[str, list[str]],
    facts: Iterable[str],
    state: Iterable[str],
    horizon: int,
) -> str:
    lists = " ".join(f"{kind} : {{{', '.join(names)}}};" for kind, names in objects.items())
    return "\n".join(
        [
            "non-fluents nf_generated {",
            f"    domain = {domain};",
            f"    objects {{ {lists} }};",
            "    non-fluents {",
            *(f"        {fact};" for fact in facts),
            "    };",
            "}",
            "instance generated {",
            f"    domain = {domain};",
            "    non-fluents = nf_generated;",
            "    init-state {",
            *(f"        {fact};" for fact in state),
            "    };",
            "    max-nondef-actions = pos-inf;",
            f"    horizon = {horizon};",
            "    discount = 1.0;",
            "}",
            "",
        ]
    )
