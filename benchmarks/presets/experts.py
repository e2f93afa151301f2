"""Feedback rules of one line each, written by hand: what a policy should beat.

They are baselines for measuring and are used for nothing else.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.evaluation import Policy
from mdpo_rddl.problem.load import Problem

_BASE_FLOW, _FLOW_PER_DEGREE, _WANTED_DEGREES = 50.0, 10.0, 22.0


def expert(problem: Problem) -> Policy:
    """The rule for a problem of HVAC, PowerGen or Reservoir.

    Raises:
      InputError: if there is none for the domain.
    """
    rule = _RULES.get(problem.domain_name)
    if rule is None:
        known = ", ".join(_RULES)
        raise InputError(f"{problem.domain_path}: no expert for it, there is one for {known}")
    shapes = problem.model.variable_params
    sizes = {kind: len(names) for kind, names in problem.model.type_to_objects.items()}
    values = {
        name: np.reshape(value, [sizes[kind] for kind in shapes[name]])
        for name, value in problem.model.non_fluents.items()
    }
    return lambda step, state: rule(values, state)


def _ventilate(values: Mapping[str, Any], state: Mapping[str, Any]) -> dict[str, Any]:
    """More air where it is too cold."""
    flow = _BASE_FLOW + _FLOW_PER_DEGREE * (_WANTED_DEGREES - np.asarray(state["temp-zone"]))
    return {"fan-in": np.maximum(flow, values["OUT-AIR-FLOW"])}


def _merit_order(values: Mapping[str, Any], state: Mapping[str, Any]) -> dict[str, Any]:
    """Serves the demand, the cheapest plants first."""
    distance = float(np.squeeze(state["temperature"])) - values["MIN-DEMAND-TEMP"]
    left = float(values["MIN-CONSUMPTION"] + values["DEMAND-EXP-COEF"] * distance**2)
    production = np.zeros_like(values["COST-PER-UNIT"], dtype=float)
    for plant in np.argsort(values["COST-PER-UNIT"], kind="stable"):
        if left <= 0.0:
            break
        least, most = values["PROD-UNITS-MIN"][plant], values["PROD-UNITS-MAX"][plant]
        production[plant] = np.clip(left, least, most)
        left -= production[plant]
    return {"curProd": production}


def _release_surplus(values: Mapping[str, Any], state: Mapping[str, Any]) -> dict[str, Any]:
    """Releases what stands above the lowest wanted level."""
    surplus = np.asarray(state["rlevel"]) - values["MIN_LEVEL"]
    return {"release": np.clip(surplus, 0.0, values["TOP_RES"])}


_RULES: dict[str, Callable[[Mapping[str, Any], Mapping[str, Any]], dict[str, Any]]] = {
    "hvac": _ventilate,
    "power_gen": _merit_order,
    "reservoir_control_cont": _release_surplus,
}
