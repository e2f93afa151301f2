"""Numbers that keep the preconditions that are linear in them, such as a budget:

    (sum_{?a : asset} PRICE(?a) * buy(?a)) <= cash

A proposal that breaks one is projected onto it: each number goes by the same multiple of its
coefficient, and no further than its box allows, which leads to the nearest point in the box that
keeps the precondition (Held, Wolfe and Crowder, "Validation of subgradient optimization", 1974).
So a policy says by the size of what it proposes who gives way to a budget: small proposals next to
large ones do, and large ones side by side share what there is. Integers go on to a whole number,
but those for which there is room to the nearer one. A precondition about a single number narrows
the box; the others are projected onto in turn.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from mdpo_rddl.planner.model.expressions import compiled_expression
from mdpo_rddl.planner.plans.places import places_of
from mdpo_rddl.planner.programs.quick import once_jit
from mdpo_rddl.problem.implications import Comparison, comparisons

Actions = dict[str, Array]

# Newton's method for the multiple is mostly done in fewer; numbers in boxes share what is left
_NEWTON_STEPS = 6
# for rounding, as the environment checks in 64 bit; and what a strict inequality leaves
_MARGIN, _LEAST_SLACK = 1e-6, 1e-4
# by so much of what is added up an equality may be missed in 32 bit; play makes it exact in 64
_ROUNDING = 2e-6
# projections onto equalities, each of which takes off all but rounding, 1e-7 of what is too much,
# and where they have numbers in common
_ROUNDS, _COUPLED_ROUNDS = 4, 50
# steps of the bisection that rounds integers, and how far apart they are from being rounded to the
# nearer one, for equal ones not to be all at once
_ROUNDINGS, _SPREAD = 7, 0.1
_WHOLE = 1e-4
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
      reads: whether each reads a number, in any state [G, D].
      is_exact: whether it is half of an equality.
    """

    slack: _Slack
    coefficients: np.ndarray | None
    reads: np.ndarray
    is_exact: bool

    @property
    def is_bound(self) -> bool:
        """Whether each is about a single number."""
        return bool(np.all(np.count_nonzero(self.reads, axis=1) <= 1))

    def at(self, slack: Callable[[Array], Array], given: Array) -> Array | np.ndarray:
        """The coefficients [G, D], those that change by the slack of numbers [D]."""
        return -jax.jacrev(slack)(given) if self.coefficients is None else self.coefficients


class LinearLimits:
    """Projects the numbers of a proposal, D in all, onto linear preconditions.

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
        boxes = {name: compiled.constraints.bounds[name] for name in values}
        sizes = [value.size for value in values.values()]
        self._places = places_of(self._shapes)
        self._noop = np.zeros(sum(sizes), np.float32)
        for name, place in self._places.items():
            self._noop[place] = np.ravel(values[name])
        self._are_integers = np.repeat([kinds[name] == "int" for name in values], sizes)
        self._lower, self._upper = np.zeros(self._noop.size), np.zeros(self._noop.size)
        for name, place in self._places.items():
            lower, upper = (np.broadcast_to(end, self._shapes[name]).ravel() for end in boxes[name])
            is_integer = kinds[name] == "int"
            self._lower[place] = np.ceil(lower) if is_integer else lower
            self._upper[place] = np.floor(upper) if is_integer else upper
        read = places if values else ()
        linear: list[_Linear] = []
        self._judged: dict[int, list[_Linear]] = {}
        for number in read:
            parts = list(comparisons(rddl.preconditions[number], values.keys()))
            found = [self._read(compiled, part) for part in parts if part is not None]
            linear += [one for each in found for one in each]
            is_judged = all(parts) and all(found)
            if is_judged and not any(part.operator == "<" for part in parts if part):
                self._judged[number] = [one for each in found for one in each]
        self._bounds = [one for one in linear if one.is_bound]
        self._preconditions = [one for one in linear if not one.is_bound]
        sums = [one.reads for one in self._preconditions if one.is_exact]
        if any(np.any(reads[:, self._are_integers]) for reads in sums):
            self._rounds = 1  # what is rounded would be moved on
        elif self._are_coupled():
            self._rounds = _COUPLED_ROUNDS
        else:
            self._rounds = _ROUNDS if sums else 1
        self.is_needed = bool(linear)

    def __call__(self, proposal: Mapping[str, Array], state: Mapping[str, Any]) -> Actions:
        """The proposal with its numbers elsewhere where they break such a precondition.

        Args:
          proposal: per action fluent [*shape].
          state: all fluents, each of its shape.
        """
        fluents = {**state, **proposal}
        given = self._flat(proposal)
        box = self._box(given, fluents)

        def projected(numbers: Array) -> Array:
            for one in self._preconditions:
                numbers = self._projected(one, numbers, box, fluents)
            return numbers

        def again(search: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            number, _, numbers = search
            return number + 1, numbers, projected(numbers)

        def is_moving(search: tuple[Array, Array, Array]) -> Array:
            number, before, numbers = search
            is_far = jnp.abs(numbers - before) > _ROUNDING / 2.0 * (1.0 + jnp.abs(numbers))
            return (number < self._rounds) & jnp.any(is_far)

        taken = jnp.clip(given, *box)
        if self._rounds > 1:
            first = jnp.array(1), taken, projected(taken)
            taken = lax.while_loop(is_moving, again, first)[2]
        else:
            taken = projected(taken)
        actions = {**proposal}
        for name, value in self._parts(taken).items():
            like = jnp.asarray(proposal[name])
            # what keeps all is left as it is, to the last bit
            is_same = value == like.astype(value.dtype)
            actions[name] = jnp.where(is_same, like, value.astype(like.dtype))
        return actions

    def judged(self, place: int) -> Callable[[Mapping[str, Any]], Array] | None:
        """Whether a precondition holds but for rounding, of all fluents; None if `==` is exact.

        It is looked at so where real numbers are to be equal, or nearly.

        Args:
          place: among the problem's preconditions.
        """
        judged = self._judged.get(place, [])
        are_close = [self._is_close(one) for one in judged]
        if not any(are_close):
            return None

        def holds(fluents: Mapping[str, Any]) -> Array:
            numbers = self._flat(fluents)
            legal = jnp.array(True)
            for one, is_close in zip(judged, are_close, strict=True):
                slack = self._slack_of_numbers(one.slack, fluents)
                size = jnp.abs(one.at(slack, numbers)) @ jnp.abs(numbers)
                least = -_ROUNDING * (1.0 + size) if is_close else 0.0
                legal &= jnp.all(slack(numbers) >= least)
            return legal

        return holds

    def _is_close(self, one: _Linear) -> bool:
        """Whether real numbers are to be equal to something, or nearly."""
        own = one.coefficients
        if not np.any(one.reads[:, ~self._are_integers]):
            return False
        others = [other.coefficients for other in self._preconditions]
        return one.is_exact or any(
            own is not None and other is not None and np.array_equal(other, -own)
            for other in others
        )

    def _are_coupled(self) -> bool:
        """Whether equalities have numbers in common with others."""
        exact = [one.reads for one in self._preconditions if one.is_exact]
        others = [one.reads for one in self._preconditions if not one.is_exact]
        # of an equality there are two halves
        count = sum(np.count_nonzero(reads, axis=0) for reads in exact) / 2
        return bool(np.any((count > 0) & (count + sum(reads.sum(axis=0) for reads in others) > 1)))

    def _flat(self, values: Mapping[str, Any]) -> Array:
        """The numbers [D] of what has all of them."""
        return jnp.concatenate(
            [jnp.ravel(jnp.asarray(values[name], jnp.float32)) for name in self._shapes]
        )

    def _box(self, given: Array, fluents: Mapping[str, Any]) -> tuple[Array, Array]:
        """The least and the largest value of each number, in this state [D].

        Args:
          given: the numbers as proposed [D].
          fluents: all others.
        """
        least, most = jnp.asarray(self._lower), jnp.asarray(self._upper)
        if not self._bounds:
            return least, most
        # once more from there, for what rounding has lost on the way
        near = jnp.clip(given, *self._bounded(given, fluents))
        lower, upper = self._bounded(near, fluents)
        # reals keep away from what is only computed, if there is room
        margin = _MARGIN * (1.0 + jnp.abs(near))
        is_narrow = upper - lower < 2.0 * margin
        least = jnp.where((lower > least) & ~is_narrow, lower + margin, lower)
        most = jnp.where((upper < most) & ~is_narrow, upper - margin, upper)
        integers = self._are_integers
        return (
            jnp.where(integers, jnp.ceil(lower - _WHOLE), least),
            jnp.where(integers, jnp.floor(upper + _WHOLE), most),
        )

    def _bounded(self, given: Array, fluents: Mapping[str, Any]) -> tuple[Array, Array]:
        """The box as it comes out from such numbers [D]."""
        least, most = jnp.asarray(self._lower), jnp.asarray(self._upper)
        for one in self._bounds:
            slack = self._slack_of_numbers(one.slack, fluents)
            coefficients = one.at(slack, given)
            unit = jnp.where(coefficients == 0.0, 1.0, coefficients)
            end = given + slack(given)[:, np.newaxis] / unit
            is_end = jnp.isfinite(end)
            above = jnp.min(jnp.where(is_end & (coefficients > 0.0), end, jnp.inf), axis=0)
            below = jnp.max(jnp.where(is_end & (coefficients < 0.0), end, -jnp.inf), axis=0)
            least, most = jnp.maximum(least, below), jnp.minimum(most, above)
        return least, most

    def _projected(
        self, one: _Linear, given: Array, box: tuple[Array, Array], fluents: Mapping[str, Any]
    ) -> Array:
        """The numbers in the box nearest to what is given that keep a precondition [D].

        Args:
          one: the precondition.
          given: the numbers [D].
          box: their least and largest values.
          fluents: all others.
        """
        slack = self._slack_of_numbers(one.slack, fluents)
        coefficients, excess = one.at(slack, given), -slack(given)
        weights, room = jnp.abs(coefficients), self._room(given, box, coefficients)
        whole = jnp.sum(jnp.where(weights > 0.0, weights * room, 0.0), axis=1)
        # one that no point of the box keeps is left to others
        is_over = (excess > 0.0) & (excess <= whole)
        excess = jnp.where(is_over, excess, 0.0)
        # an equality leaves no room for one
        is_exact = one.is_exact and not np.any(one.reads[:, self._are_integers])
        share = 0.0 if is_exact else _MARGIN
        margin = jnp.where(is_over, share * (weights @ jnp.abs(given)), 0.0)
        steps = _steps(weights, room, jnp.minimum(excess + margin, whole))
        # groups may have numbers in common
        change = jnp.max(jnp.where(coefficients < 0.0, steps, 0.0), axis=0)
        change -= jnp.max(jnp.where(coefficients > 0.0, steps, 0.0), axis=0)
        if np.any(self._are_integers):
            change = _rounded(change, coefficients, excess, self._are_integers)
        # a bound or a coefficient that is no number says nothing
        return given + jnp.where(jnp.isfinite(change), change, 0.0)

    def _room(
        self, given: Array, box: tuple[Array, Array], coefficients: Array | np.ndarray
    ) -> Array:
        """How far each number can go for each group [G, D]; infinite where nothing ends it."""
        noop, (lower, upper) = self._noop, box
        # without a bound, the no-op is the end, if it is on the way
        lower = jnp.where(jnp.isfinite(lower) | (given <= noop), lower, noop)
        upper = jnp.where(jnp.isfinite(upper) | (given >= noop), upper, noop)
        away = jnp.where(coefficients > 0.0, given - lower, upper - given)
        return jnp.where(coefficients == 0.0, 0.0, jnp.maximum(away, 0.0))

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

    def _read(self, compiled: Any, comparison: Comparison) -> list[_Linear]:
        """A comparison as what is linear in the numbers; nothing if it is not."""
        is_exact = comparison.operator == "=="
        found = [
            self._linear(compiled, *slacks, is_exact) for slacks in _slacks_of(compiled, comparison)
        ]
        return [one for one in found if one is not None]

    def _linear(
        self, compiled: Any, slack: _Slack, guarded: _Slack, is_exact: bool
    ) -> _Linear | None:
        """The precondition with its coefficients; None if it is not linear, or reads no number.

        Args:
          compiled: the exact model.
          slack: as if it were always asked for.
          guarded: infinite where it is not.
          is_exact: whether it is half of an equality.
        """

        def slopes(fluents: Any, numbers: Array) -> Array:
            return -jax.jacrev(self._slack_of_numbers(slack, fluents))(numbers)

        fluents = compiled.split_fluent_nonfluent(compiled.init_values)[0]
        groups = jax.eval_shape(slack, {**fluents, **self._parts(jnp.asarray(self._noop))}).size
        if groups * self._noop.size > _MOST_COEFFICIENTS:
            return None
        slopes = once_jit(slopes)
        random, seen = np.random.default_rng(0), []
        for _ in range(_DRAWS):
            values = {n: _other(compiled.rddl, random, n, value) for n, value in fluents.items()}
            first, second = (
                np.asarray(slopes(values, self._noop + random.normal(size=self._noop.size)))
                for _ in range(2)
            )
            if not _are_close(first, second):
                return None
            seen.append(first)
        if not np.any(seen):
            return None
        is_constant = all(_are_close(seen[0], each) for each in seen)
        reads = np.any(seen, axis=0)
        return _Linear(guarded, seen[0] if is_constant else None, reads, is_exact)


def _steps(weights: Array, room: Array, excess: Array) -> Array:
    """How far each number goes for each group, the same multiple of its weight [G, D].

    Args:
      weights: what a unit of each gives, not below 0 [G, D].
      room: how far each can go at most [G, D].
      excess: what all of a group's have to give; no more than they can [G].
    """

    def steps(multiples: Array) -> Array:
        return jnp.minimum(multiples[:, np.newaxis] * weights, room)

    def newton(_: Any, multiples: Array) -> Array:
        # what they give is concave in the multiple, so that no step goes too far
        own = steps(multiples)
        slope = jnp.sum(jnp.where(own < room, weights**2, 0.0), axis=1)
        missing = jnp.maximum(excess - jnp.sum(weights * own, axis=1), 0.0)
        more = jnp.where(slope > 0.0, missing / jnp.where(slope > 0.0, slope, 1.0), 0.0)
        return multiples + more

    own = steps(lax.fori_loop(0, _NEWTON_STEPS, newton, jnp.zeros(excess.shape)))
    missing = jnp.maximum(excess - jnp.sum(weights * own, axis=1), 0.0)
    rest = jnp.where(jnp.isfinite(room), room - own, 0.0)
    whole = jnp.sum(weights * rest, axis=1)
    share = jnp.minimum(missing / jnp.where(whole > 0.0, whole, 1.0), 1.0)
    return own + share[:, np.newaxis] * rest


def _rounded(
    change: Array, coefficients: Array | np.ndarray, excess: Array, integers: np.ndarray
) -> Array:
    """The changes [D], of which integers are rounded up, but down where others give enough.

    Args:
      change: as far as reals would go [D].
      coefficients: what a unit takes [G, D].
      excess: what all changes of a group have to give [G].
    """
    ties = _SPREAD * (np.arange(len(integers)) * _GOLDEN % 1.0)
    # coefficients are rounded to 32 bit, integers are not
    enough = excess - _MARGIN * (1.0 + excess)

    def rounded(lowered: Array) -> Array:
        own = jnp.min(jnp.where(coefficients != 0.0, lowered[:, np.newaxis], 1.0), axis=0)
        down = jnp.clip(own - ties, 0.0, 1.0 - _WHOLE)
        size = jnp.ceil(jnp.abs(change) - down - _WHOLE)
        return jnp.where(integers, jnp.sign(change) * jnp.maximum(size, 0.0), change)

    def halved(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2.0
        fits = -(coefficients @ rounded(middle)) >= enough
        return jnp.where(fits, middle, low), jnp.where(fits, high, middle)

    ends = jnp.zeros(excess.shape), jnp.full(excess.shape, 1.0 + _SPREAD)
    return rounded(lax.fori_loop(0, _ROUNDINGS, halved, ends)[0])


def _slacks_of(compiled: Any, comparison: Comparison) -> list[tuple[_Slack, _Slack]]:
    """How far a comparison is from being broken [G]: of an equality in both directions.

    Returns:
      Of each direction, as if no guard stood before it, and infinite where a guard does.
    """
    sides = [compiled_expression(compiled, side, compiled.REAL) for side in comparison.sides]
    guards = [
        (compiled_expression(compiled, guard, jnp.bool_), truth, scope)
        for guard, truth, scope in comparison.guards
    ]
    nonfluents = compiled.split_fluent_nonfluent(compiled.init_values)[1]
    least = _LEAST_SLACK if comparison.operator == "<" else 0.0
    sizes = [len(compiled.rddl.type_to_objects[kind]) for kind in comparison.variables.values()]

    def slack(sign: float, fluents: Any) -> Array:
        left, right = (side(fluents, nonfluents) for side in sides)
        room = sign * (right - comparison.sign * left) - least * (1.0 + jnp.abs(right))
        return jnp.ravel(jnp.broadcast_to(room, sizes))

    def guarded(sign: float, fluents: Any) -> Array:
        asked = jnp.ones(sizes, bool)
        for guard, truth, scope in guards:
            value = jnp.broadcast_to(guard(fluents, nonfluents) == truth, sizes[:scope])
            asked &= jnp.reshape(value, sizes[:scope] + [1] * (len(sizes) - scope))
        return jnp.where(jnp.ravel(asked), slack(sign, fluents), jnp.inf)

    signs = [1.0, -1.0] if comparison.operator == "==" else [1.0]
    return [(partial(slack, sign), partial(guarded if guards else slack, sign)) for sign in signs]


def _are_close(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.allclose(one, other, _TOLERANCE, _TOLERANCE * np.max(np.abs(one), initial=0.0)))


def _other(rddl: Any, random: np.random.Generator, name: str, value: Any) -> np.ndarray:
    """Another value of a fluent, drawn at random."""
    value, kind = np.asarray(value), rddl.variable_ranges[name]
    if kind == "bool":
        return random.random(value.shape) < 0.5
    if kind == "real":
        return (value + random.normal(size=value.shape)).astype(value.dtype)
    if kind == "int":
        return (value + random.integers(1, 5, value.shape)).astype(value.dtype)
    return random.integers(0, len(rddl.type_to_objects[kind]), value.shape).astype(value.dtype)
