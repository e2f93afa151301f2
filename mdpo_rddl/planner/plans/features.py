"""What an action fluent's objects can see of the state, shared by all objects.

RDDL is lifted: an action fluent a(?x) stands for one action per object x, and a state fluent
f(?x) describes the same objects. A feature is a number per object of the action, made from the
fluents by types alone, so that one weight serves all objects (and a rule such as "release what
stands above the minimum" is a handful of numbers, however many reservoirs there are).
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.planner.plans.neighbours import Neighbours, distant_neighbours, related_neighbours


class Feature(NamedTuple):
    """One feature of one action fluent.

    Attributes:
      name: for diagnostics, such as "rlevel" or "rlevel via RES_CONNECT".
      fluent: the state fluent that it reads.
      lay: from that fluent's value [*its shape], or its means [objects], to one per object, an
        array that broadcasts to the action's shape: of size 1 along the axes on which it does not
        depend. An axis of replicas may follow, and then follows in what is returned.
      means: what takes the mean over each object's neighbours [objects, values of the fluent];
        None if the value itself is laid out.
    """

    name: str
    fluent: str
    lay: Callable[[Any], Any]
    means: np.ndarray | None = None


class ActionFeatures(NamedTuple):
    """The features of one action fluent.

    Attributes:
      state: those that change with the state.
      constant: by name, those of the objects themselves [*action shape], with mean 0 and
        deviation 1 over the objects.
      moments: by name, the mean and the deviation that they had; also of those that are the same
        for all objects, which are no features.
    """

    state: tuple[Feature, ...]
    constant: dict[str, np.ndarray]
    moments: dict[str, tuple[float, float]]


def array_module(value: Any) -> Any:
    """The module whose functions take an array: numpy, or jax.numpy of whatever JAX traces.

    So one formula serves both, and who plays on numpy need not import JAX.
    """
    if isinstance(value, np.ndarray | np.generic):
        return np
    from jax import numpy

    return numpy


def observed_fluents(rddl: Any) -> list[str]:
    """What a policy may read: the observations of a partially observed problem, else the state."""
    return list(rddl.observ_fluents or rddl.state_fluents)


def action_features(
    rddl: Any,
    values: Mapping[str, Any],
    action: str,
    distant: bool = False,
    others: Mapping[str, Sequence[str]] | None = None,
) -> ActionFeatures:
    """Finds the features of an action fluent.

    A state fluent counts with its value at the action's own objects where the types match, and
    with its mean over the objects that the action knows nothing of. A fluent of one object
    also counts with its mean over the neighbours, for each binary bool non-fluent that relates
    the types, in both directions.

    Args:
      rddl: pyRDDLGym's lifted model.
      values: per fluent and non-fluent, an array of its shape; read for the non-fluents.
      action: the action fluent's name.
      distant: whether those of `distant_neighbours` are features, too.
      others: the types of what the policy remembers or looks up, which is read as fluents are.
    """
    types = list(rddl.variable_params[action])
    shape = tuple(np.shape(values[action]))
    features = []
    readable = {name: list(rddl.variable_params[name]) for name in observed_fluents(rddl)}
    # fluents of the same types have the same neighbours, whose means are taken together
    known: dict[tuple[str, ...], list[Neighbours]] = {}
    for fluent, own in {**readable, **(others or {})}.items():
        if len(own) == 1:
            features.extend(_at_each_end(fluent, fluent, own[0], types, shape))
        else:
            features.append(Feature(fluent, fluent, _aligned(own, types, shape)))
        if (key := tuple(own)) not in known:
            near = related_neighbours(rddl, values, own, types)
            far = distant_neighbours(rddl, values, own, types) if distant else []
            known[key] = [*near, *far]
        for name, kind, means in known[key]:
            label = f"{fluent} {name}"
            if kind is None:
                features.append(Feature(label, fluent, partial(_reshaped, shape), means))
            else:
                features.extend(_at_each_end(label, fluent, kind, types, shape, means))
    return ActionFeatures(tuple(features), *_constants(rddl, values, types, shape))


def _aligned(
    own: Sequence[str], types: Sequence[str], shape: tuple[int, ...]
) -> Callable[[Any], Any]:
    """Lays a fluent's axes along the action's axes of the same types; averages over the rest."""
    axes: list[int | None] = []
    for kind in own:
        free = (axis for axis, other in enumerate(types) if other == kind and axis not in axes)
        axes.append(next(free, None))
    rest = tuple(number for number, axis in enumerate(axes) if axis is None)
    kept = [axis for axis in axes if axis is not None]
    order = [int(place) for place in np.argsort(kept)]
    broadcast = tuple(size if axis in kept else 1 for axis, size in enumerate(shape))

    def spread(value: Any) -> Any:
        # numpy's methods are jax's: constants are laid out without a program
        replicas = value.shape[len(own) :]
        value = value.mean(axis=rest) if rest else value
        return value.transpose(order + [len(order)] * len(replicas)).reshape(broadcast + replicas)

    return spread


def _at_each_end(
    name: str,
    fluent: str,
    kind: str,
    types: Sequence[str],
    shape: tuple[int, ...],
    means: np.ndarray | None = None,
) -> list[Feature]:
    """A number per object of a type, for each of the action's arguments that has this type.

    Where none has, there is one feature, the mean over the objects.
    """
    places = [place for place, other in enumerate(types) if other == kind]
    if not places:
        return [Feature(name, fluent, _aligned([kind], types, shape), means)]
    features = []
    for place in places:
        sizes = tuple(size if axis == place else 1 for axis, size in enumerate(shape))
        label = name if len(places) == 1 else f"{name} at argument {place + 1}"
        features.append(Feature(label, fluent, partial(_reshaped, sizes), means))
    return features


def _reshaped(sizes: tuple[int, ...], value: Any) -> Any:
    return value.reshape(sizes + value.shape[1:])


def _constants(
    rddl: Any, values: Mapping[str, Any], types: Sequence[str], shape: tuple[int, ...]
) -> tuple[dict[str, np.ndarray], dict[str, tuple[float, float]]]:
    found, moments = {}, {}
    for name in rddl.non_fluents:
        own = list(rddl.variable_params[name])
        if not set(own) & set(types):
            continue
        value = np.asarray(values[name], float)
        per_object = np.broadcast_to(_aligned(own, types, shape)(value), shape)
        deviation = per_object.std()
        moments[name] = float(per_object.mean()), float(deviation)
        if deviation > 1e-6 * np.max(np.abs(per_object), initial=1e-9):
            found[name] = (per_object - per_object.mean()) / deviation
    return found, moments
