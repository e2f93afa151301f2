"""Observations and actions by ground fluents, as an environment that is not vectorized has them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel

from mdpo_rddl.errors import InputError

_TYPES = {"real": np.float64, "int": np.int64, "bool": np.bool_}


def is_grounded(model: RDDLLiftedModel, observation: Mapping[str, Any]) -> bool:
    """Whether an observation is by ground fluents: a scalar for each, such as `temp___z1`.

    One of a problem without state is empty, and counts as what a vectorized environment shows.
    """
    return any(name not in model.variable_params for name in observation) or (
        bool(observation) and all(np.ndim(value) == 0 for value in observation.values())
    )


def lifted(model: RDDLLiftedModel, observation: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The observation as a vectorized environment shows it.

    Args:
      model: of the problem.
      observation: per ground fluent a number, a bool, an object's name, or None where nothing is
        observed yet.

    Returns:
      Per fluent an array [*shape]; [1] for a fluent without parameters.

    Raises:
      InputError: naming a fluent that is unknown or missing.
    """
    ranges = model.observ_ranges if model.observ_fluents else model.state_ranges
    names = {name: model.variable_groundings[name] for name in ranges}
    wanted = {ground for grounds in names.values() for ground in grounds}
    for difference, what in (
        (wanted - observation.keys(), "lacks"),
        (observation.keys() - wanted, "has the unknown fluent"),
    ):
        if difference:
            raise InputError(f"the observation {what} {min(difference)}")
    found = {}
    for name, grounds in names.items():
        values = [observation[ground] for ground in grounds]
        shape = model.object_counts(model.variable_params[name]) or (1,)
        found[name] = _array(values, ranges[name]).reshape(shape)
    return found


def _array(values: list[Any], kind: str) -> np.ndarray:
    if any(value is None for value in values):
        return np.array(values, dtype=object)
    if any(isinstance(value, str) for value in values):
        return np.array(values, dtype=np.str_)
    return np.array(values, dtype=_TYPES.get(kind, np.int64))


def grounded(model: RDDLLiftedModel, actions: Mapping[str, Any]) -> dict[str, Any]:
    """Actions per ground fluent, as Python's numbers and bools.

    Args:
      model: of the problem.
      actions: per action fluent an array [*shape].
    """
    return {
        ground: value.item()
        for name, values in actions.items()
        for ground, value in model.ground_var_with_values(name, np.asarray(values))
    }
