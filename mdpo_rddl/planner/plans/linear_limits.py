"""Numbers that keep the preconditions that are linear in them, such as a budget:

    (sum_{?a : asset} PRICE(?a) * buy(?a)) <= cash

Where a proposal breaks one, it is projected: each number goes back towards the no-op by the same
multiple of its coefficient, and no further than to the no-op. That is the nearest point between
both that keeps it (Euclidean projection: Held, Wolfe and Crowder, "Validation of subgradient
optimization", 1974). So a policy says by the size of what it proposes who gives way: small
proposals next to large ones do, and large ones side by side share what there is. Integers are
rounded down, and up again as far as what is left goes. Several preconditions are projected onto in
turn.
"""

import itertools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.programs.quick import once_jit
from mdpo_rddl.problem.implications import conjuncts

Actions = dict[str, Array]

# Newton's method for the multiple is mostly done in fewer; what is left to take is shared equally
_NEWTON_STEPS = 6
# what reals leave of what there is, for the environment checks in 64 bit; and what a strict
# inequality leaves
_KEPT, _LEAST_SLACK = 1e-5, 1e-4
# steps of the bisection that rounds integers, and how far apart they are from being rounded up, for
# equal ones not to be all at once
_ROUNDINGS, _SPREAD = 7, 0.1
_GOLDEN = 0.6180339887498949
# groups times numbers of one precondition; with more, its sums would take too long
_MOST_COEFFICIENTS = 20_000
# at so many random states and actions a slack is looked at, to see whether it is linear
_DRAWS = 4
_TOLERANCE = 1e-3

_Slack = Callable[[Any], Array]


class _Linear(NamedTuple):
    """One precondition, or a part of one, for each object that its `forall`s name.

    Attributes:
      slack: of all fluents, how far it is from being broken [G].
      coefficients: how much of that a unit of each number takes [G, D]; None where this changes
        with the state.
    """

    slack: _Slack
    coefficients: np.ndarray | None


class LinearLimits:
    """Takes back so much of a proposal's numbers, D in all, that linear preconditions are kept.

    Attributes:
      is_needed: whether there is any such precondition.
    """

    def __init__(self, compiled: Any, places: tuple[int, ...]) -> None:
        """Finds the preconditions.

        Args:
          compiled: the exact model as JaxPlan compiles it.
          places: of those to look at among the problem's preconditions.
        """
        rddl = compiled.rddl
        kinds = {name: rddl.variable_ranges[name] for name in rddl.action_fluents}
        values = {
            name: np.asarray(compiled.init_values[name], np.float32)
            for name, kind in kinds.items()
            if kind in ("int", "real")
        }
        self._shapes = {name: value.shape for name, value in values.items()}
        sizes = [value.size for value in values.values()]
        ends = np.cumsum([0, *sizes]).tolist()
        self._places = {
            name: slice(*pair) for name, pair in zip(values, itertools.pairwise(ends), strict=True)
        }
        self._noop = np.zeros(ends[-1], np.float32)
        for name, place in self._places.items():
            self._noop[place] = np.ravel(values[name])
        self._are_integers = np.repeat([kinds[name] == "int" for name in values], sizes)
        parts = [part for place in places for part in conjuncts(rddl.preconditions[place])]
        slacks = [_slack_of(compiled, *part) for part in parts] if values else []
        found = [self._linear(compiled, slack) for slack in slacks if slack is not None]
        self._preconditions = [one for one in found if one is not None]
        self.is_needed = bool(self._preconditions)

    def __call__(self, proposal: Mapping[str, Array], state: Mapping[str, Any]) -> Actions:
        """The proposal with its numbers nearer to the no-op where they break such a precondition.

        Args:
          proposal: per action fluent [*shape].
          state: all fluents, each of its shape.
        """
        fluents = {**state, **proposal}
        given = jnp.concatenate(
            [jnp.ravel(jnp.asarray(proposal[name], jnp.float32)) for name in self._shapes]
        )
        taken = given
        for one in self._preconditions:
            taken = self._projected(one, taken, fluents)
        actions = {**proposal}
        for name, value in self._parts(taken).items():
            like = jnp.asarray(proposal[name])
            # what keeps all is left as it is, to the last bit
            is_same = value == like.astype(value.dtype)
            actions[name] = jnp.where(is_same, like, value.astype(like.dtype))
        return actions

    def _projected(self, one: _Linear, given: Array, fluents: Mapping[str, Any]) -> Array:
        """The numbers as near to what is given as a precondition allows [D].

        Args:
          one: the precondition.
          given: the numbers [D].
          fluents: all others.
        """
        slack = self._slack_of_numbers(one.slack, fluents)
        change, excess = given - self._noop, -slack(given)
        coefficients = one.coefficients
        if coefficients is None:
            coefficients = -jax.jacrev(slack)(given)
        # those whose change takes nothing stay
        weights = jnp.maximum(coefficients * jnp.sign(change), 0.0)
        size = jnp.abs(change)
        whole = weights @ size
        # where not even the no-op of the others keeps it, less of the change does not help
        is_over = (excess > 0.0) & (excess <= whole)
        excess, room = jnp.where(is_over, excess, 0.0), whole - excess
        left = _reduced(size, weights, excess)
        integers = self._are_integers
        if not np.all(integers):
            left = jnp.where(integers, left, _scaled(left, weights, (1.0 - _KEPT) * room))
        if np.any(integers):
            left = jnp.where(integers, _rounded(left, weights, room, integers), left)
        is_less = jnp.any((weights > 0.0) & is_over[:, np.newaxis], axis=0)
        return jnp.where(is_less, self._noop + jnp.sign(change) * left, given)

    def _parts(self, numbers: Array) -> Actions:
        """The numbers [D] per action fluent [*shape]."""
        return {
            name: jnp.reshape(numbers[self._places[name]], shape)
            for name, shape in self._shapes.items()
        }

    def _slack_of_numbers(
        self, slack: _Slack, fluents: Mapping[str, Any]
    ) -> Callable[[Array], Array]:
        return lambda numbers: slack({**fluents, **self._parts(numbers)})

    def _linear(self, compiled: Any, slack: _Slack) -> _Linear | None:
        """The precondition with its coefficients; None if it is not linear, or reads no number."""

        def slopes(fluents: Any, numbers: Array) -> Array:
            return -jax.jacfwd(self._slack_of_numbers(slack, fluents))(numbers)

        slopes = once_jit(slopes)
        random, seen = np.random.default_rng(0), []
        fluents = compiled.split_fluent_nonfluent(compiled.init_values)[0]
        for _ in range(_DRAWS):
            values = {name: _perturbed(random, value) for name, value in fluents.items()}
            first, second = (
                np.asarray(slopes(values, _perturbed(random, self._noop))) for _ in range(2)
            )
            if not _are_close(first, second):
                return None
            seen.append(first)
        if not np.any(seen) or seen[0].size > _MOST_COEFFICIENTS:
            return None
        is_constant = all(_are_close(seen[0], each) for each in seen[1:])
        return _Linear(slack, seen[0] if is_constant else None)


def _reduced(size: Array, weights: Array, excess: Array) -> Array:
    """How much of the changes is left if the same multiple of the weights is taken off each [D].

    Args:
      size: of the changes [D].
      weights: what a unit of each takes, not below 0 [G, D].
      excess: by how much the changes take too much [G].
    """
    multiples = jnp.zeros(excess.shape)

    def losses(multiples: Array) -> Array:
        return jnp.minimum(multiples[:, np.newaxis] * weights, size)

    for _ in range(_NEWTON_STEPS):
        # concave in the multiple, so that no step goes too far
        lost = losses(multiples)
        slope = jnp.sum(jnp.where(lost < size, weights**2, 0.0), axis=1)
        missing = jnp.maximum(excess - jnp.sum(weights * lost, axis=1), 0.0)
        multiples += jnp.where(slope > 0.0, missing / jnp.where(slope > 0.0, slope, 1.0), 0.0)
    return size - jnp.max(losses(multiples), axis=0)


def _scaled(left: Array, weights: Array, room: Array) -> Array:
    """The same share of all changes [D] of a group, as large as there is room for [G]."""
    taken = weights @ left
    is_over = taken > room
    share = jnp.where(is_over, jnp.maximum(room, 0.0) / jnp.where(is_over, taken, 1.0), 1.0)
    return left * jnp.min(jnp.where(weights > 0.0, share[:, np.newaxis], 1.0), axis=0)


def _rounded(left: Array, weights: Array, room: Array, integers: np.ndarray) -> Array:
    """The changes [D], of which integers are rounded: up as many as there is room for [G]."""
    ties = _SPREAD * (np.arange(len(integers)) * _GOLDEN % 1.0)
    # weights and room are rounded to 32 bit, integers are not
    room = room + _KEPT * (1.0 + jnp.abs(room))

    def rounded(raised: Array) -> Array:
        own = jnp.min(jnp.where(weights > 0.0, raised[:, np.newaxis], 1.0), axis=0)
        up = jnp.clip(own - ties, 0.0, 1.0 - _KEPT)
        return jnp.where(integers, jnp.floor(left + up + _KEPT), left)

    low, high = jnp.zeros(room.shape), jnp.full(room.shape, 1.0 + _SPREAD)
    for _ in range(_ROUNDINGS):
        middle = (low + high) / 2.0
        fits = weights @ rounded(middle) <= room
        low, high = jnp.where(fits, middle, low), jnp.where(fits, high, middle)
    return rounded(low)


def _slack_of(compiled: Any, variables: Mapping[str, str], expression: Any) -> _Slack | None:
    """How far a comparison is from being broken [G]; None if it is no comparison of that kind.

    Args:
      compiled: the exact model.
      variables: of the `forall`s around it, with their types.
      expression: to compile.
    """
    kind, operator = expression.etype
    if kind != "relational" or operator not in ("<=", "<", ">=", ">"):
        return None
    aux: dict[str, Any] = {"params": {}, "overriden": {}, "exact": set()}
    smaller, larger = (compiled._jax(side, aux, dtype=compiled.REAL) for side in expression.args)
    if operator in (">=", ">"):
        smaller, larger = larger, smaller
    model = dict(aux["params"])
    nonfluents = compiled.split_fluent_nonfluent(compiled.init_values)[1]
    least = _LEAST_SLACK if operator in ("<", ">") else 0.0
    sizes = [len(compiled.rddl.type_to_objects[kind]) for kind in variables.values()]

    def slack(fluents: Any) -> Array:
        key = jax.random.PRNGKey(0)
        above, below = (side(fluents, nonfluents, model, key)[0] for side in (larger, smaller))
        room = above - below - least * (1.0 + jnp.abs(above))
        return jnp.ravel(jnp.broadcast_to(room, sizes))

    return slack


def _are_close(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.allclose(one, other, _TOLERANCE, _TOLERANCE * np.max(np.abs(one), initial=0.0)))


def _perturbed(random: np.random.Generator, value: Any) -> np.ndarray:
    """Another value of a fluent; of those that are no numbers the same."""
    value = np.asarray(value)
    if value.dtype == bool:
        return random.random(value.shape) < 0.5
    if np.issubdtype(value.dtype, np.floating):
        return (value + random.normal(size=value.shape)).astype(value.dtype)
    return value
