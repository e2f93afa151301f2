"""Whether a saved policy fits the planner that is to play it."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause, printable
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.file import SavedPolicy


def with_tuples(saved: SavedPolicy, planner: MDPOPlanner) -> SavedPolicy:
    """The policy of a file of version 0.2.0, where the tuples of a preprocessor are one tensor."""
    if planner.preprocessor is None or not isinstance(saved.policy_hyperparams, Mapping):
        return saved
    own = planner.preprocessor.HYPERPARAMS_KEY
    found, unit = saved.policy_hyperparams.get(own), unit_hyperparams(planner)[own]
    if not isinstance(found, Mapping) or not isinstance(unit, Mapping):
        return saved
    stacked = {
        name: tuple(values)
        for name, values in found.items()
        if isinstance(values, np.ndarray) and np.shape(values)[:1] == (2,)
        if isinstance(unit.get(name), tuple)
    }
    hyperparams = {**saved.policy_hyperparams, own: {**found, **stacked}}
    return dataclasses.replace(saved, policy_hyperparams=hyperparams)


def require_params(saved: SavedPolicy, planner: MDPOPlanner, source: str) -> None:
    """Raises `InputError` unless a saved policy's parameters are those of a planner's.

    Args:
      saved: the policy.
      planner: compiled for its configuration.
      source: where the policy came from, for the message.
    """
    damaged = f"{source}: damaged policy file"
    if not isinstance(saved.policy_hyperparams, Mapping) or not isinstance(saved.params, Mapping):
        raise InputError(f"{damaged}: it has no trees of tensors")
    _require_hyperparams(saved.policy_hyperparams, planner, damaged)
    try:
        expected = planner.params_structure(saved.policy_hyperparams)
    except Exception as error:  # whatever JAX makes of hyperparameters that do not fit
        raise InputError(f"{damaged}: {one_line_cause(error)}") from error
    wanted = jax.tree.map(lambda leaf: leaf.shape, expected)
    tensors = jax.tree.map(lambda leaf: leaf.shape, saved.params)
    if wanted != tensors:
        raise InputError(
            f"{source}: damaged policy file, or saved for another horizon: its tensors are "
            f"{tensors}, expected {wanted}"
        )
    types = jax.tree.map(lambda wanted, found: found.dtype == wanted.dtype, expected, saved.params)
    if not all(jax.tree.leaves(types)):
        found = sorted({str(leaf.dtype) for leaf in jax.tree.leaves(saved.params)})
        raise InputError(f"{damaged}: its parameters are {', '.join(found)}, not as the planner's")
    for leaf in jax.tree.leaves((saved.params, saved.policy_hyperparams)):
        if not np.all(np.isfinite(leaf)):
            raise InputError(f"{damaged}: it holds numbers that are not finite")


def _require_hyperparams(
    hyperparams: Mapping[str, Any], planner: MDPOPlanner, damaged: str
) -> None:
    """Raises `InputError` unless they are numbers, and a preprocessor's of its own shapes."""
    units = unit_hyperparams(planner)
    for name, found in hyperparams.items():
        unit = units.get(name, 1.0)
        structure: Any = jax.tree.structure(found)
        leaves = jax.tree.leaves(found)
        fits = bool(structure == jax.tree.structure(unit)) and [*map(np.shape, leaves)] == [
            *map(np.shape, jax.tree.leaves(unit))
        ]
        kinds = {np.asarray(leaf).dtype.kind for leaf in leaves}
        if not fits or not kinds <= set("fiu"):
            raise InputError(
                f"{damaged}: its hyperparameter {printable(name)} is not the planner's"
            )
    own = None if planner.preprocessor is None else planner.preprocessor.HYPERPARAMS_KEY
    # nothing is saved of one that scales nothing
    if own is not None and own not in hyperparams and jax.tree.leaves(units[own]):
        raise InputError(f"{damaged}: it lacks the values of the planner's preprocessor")
