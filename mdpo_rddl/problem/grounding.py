"""Observations and actions by ground fluents, as an environment that is not vectorized has them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel

from mdpo_rddl.errors import InputError

_LENGTH = 60  # characters of a value in a message
_TYPES = {"real": np.float64, "int": np.int64, "bool": np.bool_}


def require_step(model: RDDLLiftedModel, step: Any) -> None:
    """Raises `InputError` unless a step is one of the problem's: a whole number below its horizon.

    Args:
      model: of the problem.
      step: number of decisions before.
    """
    is_whole = isinstance(step, int | np.integer) and not isinstance(step, bool)
    if not is_whole or not 0 <= step < model.horizon:
        last = model.horizon - 1
        raise InputError(f"the step must be an integer from 0 to {last}, got {_short(step)}")


def require_observation(
    model: RDDLLiftedModel, observation: Any, batch: tuple[int, ...] = ()
) -> None:
    """Raises `InputError` unless it is an observation of the problem, naming what is wrong.

    Args:
      model: of the problem.
      observation: per fluent an array, or per ground fluent a scalar.
      batch: leading axes of each array.
    """
    if not isinstance(observation, Mapping):
        kind = type(observation).__name__
        raise InputError(f"the observation must be a mapping of fluents to values, got {kind}")
    arrays = {str(name): _as_array(name, value) for name, value in observation.items()}
    ranges = _observed(model)
    unknown = arrays.keys() - model.variable_params.keys()
    if unknown and any(name in ranges and arrays[name].ndim for name in arrays):
        raise InputError(f"the observation has the unknown fluent {min(unknown)}")
    if is_grounded(model, arrays):
        arrays = lifted(model, {name: array.item() for name, array in arrays.items()})
    for name in ranges:
        if name not in arrays:
            raise InputError(f"the observation lacks {name}")
        _require_values(model, name, arrays[name], batch)


def _as_array(name: Any, value: Any) -> np.ndarray:
    try:
        return np.asarray(value)
    except ValueError:  # numpy's, of lists of unequal lengths
        raise InputError(
            f"the observation has {name} that is no array, but {_short(value)}"
        ) from None


def _require_values(
    model: RDDLLiftedModel, name: str, array: np.ndarray, batch: tuple[int, ...]
) -> None:
    """Raises `InputError` unless these are values that a fluent can have."""
    # which an environment shows before the first step, in a shape of its own
    if model.observ_fluents and array.dtype == object and all(each is None for each in array.flat):
        return
    shape = model.object_counts(model.variable_params[name])
    wanted = batch + (shape or (1,))
    if array.shape not in (wanted, batch + shape):
        raise InputError(f"the observation has {name} of shape {array.shape}, it must be {wanted}")
    kind, objects = _observed(model)[name], model.type_to_objects
    if kind in _TYPES and array.dtype.kind not in "biuf":
        raise InputError(f"the observation has {name} that is no number, but {_short(array)}")
    if kind in objects and array.dtype.kind == "U":
        strange = {str(each).removeprefix("@") for each in array.flat} - set(objects[kind])
        if strange:
            raise InputError(f"the observation has {name} that is no {kind}, but {min(strange)}")


def require_batch(model: RDDLLiftedModel, step: Any, observations: Any) -> int:
    """The number of observations [N, *shape] of a step.

    Args:
      model: of the problem.
      step: number of decisions before.
      observations: per fluent its values [N, *shape].

    Raises:
      InputError: if there is no such step, or fluents are missing or of another shape.
    """
    require_step(model, step)
    count = 0
    if isinstance(observations, Mapping) and observations:
        first = np.shape(next(iter(observations.values())))
        count = first[0] if first else 0
    require_observation(model, observations, (count,))
    if count == 0:
        raise InputError("there must be at least one observation")
    return count


def _observed(model: RDDLLiftedModel) -> Mapping[str, str]:
    """The range of each fluent that is shown."""
    return model.observ_ranges if model.observ_fluents else model.state_ranges


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= _LENGTH else text[: _LENGTH - 1] + "…"


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
    ranges = _observed(model)
    names = {name: model.variable_groundings[name] for name in ranges}
    wanted = {ground for grounds in names.values() for ground in grounds}
    for difference, what in (
        (wanted - observation.keys(), "lacks"),
        (observation.keys() - wanted, "has the unknown fluent"),
    ):
        if difference:
            raise InputError(f"the observation {what} {min(map(str, difference))}")
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
