"""Reductions over pairs of objects of which few are related: computed for those alone.

RDDL says over all objects what concerns a few, `exists_{?j} [CONNECTED(?i, ?j) ^ on(?j)]`. The
relation is a non-fluent, so it is known ahead which pairs leave the result as it is, whatever the
state: here these are left out, and the others are gathered.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, core
from jax.extend.core import ClosedJaxpr

from mdpo_rddl.planner.programs.gathering import Entries, gathered, shrunk
from mdpo_rddl.planner.programs.known import (
    NEUTRAL,
    REDUCED,
    Known,
    known_move,
    known_reduction,
    known_result,
    moved,
)
from mdpo_rddl.planner.programs.traced import bind, has_equation, rewritten

# smaller arrays are computed as they are written; larger ones are not looked at
_WORTH_ENTRIES, _MOST_ENTRIES = 200, 2 * 10**6
# so many entries as they are written take as long as one that is gathered, about
_GATHERING = 8


@dataclass(frozen=True, eq=False)
class _Wide:
    """A large array that is written out only if it must be.

    Attributes:
      shape: of the whole.
      known: what is known of it.
      recipe: how the program computes the whole.
      some: computes entries of it, of a shape that is broadcast to theirs; what has been computed
        of other arrays at the same entries is kept. None if all of it is known.
    """

    shape: tuple[int, ...]
    known: Known
    recipe: Callable[[], Array]
    some: Callable[[Entries, dict[int, Any]], Any] | None = None

    @cached_property
    def whole(self) -> Array:
        """The array, written out."""
        return self.recipe()

    def at(self, entries: Entries, seen: dict[int, Any]) -> Any:
        """Some entries of it."""
        if self.some is None:
            return self.known.values[entries.axes]
        if id(self) not in seen:
            seen[id(self)] = self.some(entries, seen)
        return seen[id(self)]


def among_related(closed: ClosedJaxpr) -> ClosedJaxpr:
    """A program with the same results, in which reductions leave out what cannot change them.

    Results agree up to the order of floating-point operations. What is known are the program's
    constants. A program without large reductions is returned as it is.
    """
    if not has_equation(closed.jaxpr, _is_large_reduction):
        return closed
    return rewritten(closed, _apply, _whole)


def _is_large_reduction(equation: Any) -> bool:
    return equation.primitive.name in NEUTRAL and _is_large(equation.invars[0].aval)


def _is_large(value: Any) -> bool:
    return value.ndim > 1 and _WORTH_ENTRIES <= value.size <= _MOST_ENTRIES


def _constant(operand: Any) -> np.ndarray | None:
    """The values of an operand that depends on nothing; None for another."""
    if isinstance(operand, _Wide):
        return operand.known.values if operand.known.is_constant else None
    is_key = isinstance(operand, Array) and not isinstance(operand.dtype, np.dtype)
    return None if is_key or isinstance(operand, core.Tracer) else np.asarray(operand)


def _known(operand: Any) -> Known:
    """What is known of an operand: all of a constant, nothing of what is traced."""
    if isinstance(operand, _Wide):
        return operand.known
    if isinstance(operand, core.Tracer):
        return Known.nothing(operand.dtype)
    return Known.all_of(operand)


def _constant_array(values: np.ndarray, whole: Callable[[], Array]) -> Any:
    """An array of which all is known; where it is needed whole the program computes it."""
    return _Wide(values.shape, Known.all_of(values), whole) if values.ndim else values


def _some(operand: Any, entries: Entries) -> Any:
    """Entries of an operand, other than those of the array that is made of it."""
    return operand.at(entries, {}) if isinstance(operand, _Wide) else gathered(operand, entries)


def _whole(value: Any) -> Any:
    return value.whole if isinstance(value, _Wide) else value


def _apply(equation: Any, operands: list[Any]) -> list[Any]:
    name, result = equation.primitive.name, equation.outvars[0].aval

    def plain() -> list[Any]:
        given = [_whole(operand) for operand in operands]
        return bind(equation.primitive, equation.params, given)

    if name in NEUTRAL and isinstance(operands[0], _Wide) and not operands[0].known.is_constant:
        found = _reduced(equation, operands[0])
        return plain() if found is None else [found]
    if result.size > _MOST_ENTRIES or not isinstance(result.dtype, np.dtype):
        return plain()
    values = _computed(equation, operands)
    if values is not None:
        # what is written out for a reduction is larger
        return [values if name in NEUTRAL else _constant_array(values, lambda: plain()[0])]
    wide = _wide(equation, operands, lambda: plain()[0]) if _is_large(result) else None
    return plain() if wide is None else [wide]


def _computed(equation: Any, operands: Sequence[Any]) -> np.ndarray | None:
    """What an operation gives on constants; None of others, or if it is not looked at."""
    constants = [each for each in map(_constant, operands) if each is not None]
    name, result = equation.primitive.name, equation.outvars[0].aval
    if len(constants) < len(operands):
        return None
    if name in NEUTRAL:
        found: np.ndarray = REDUCED[name](constants[0], axis=equation.params["axes"])
        return found.astype(result.dtype)
    values = moved(equation, constants)
    if values is not None:
        return values
    known = known_result(equation, [_known(operand) for operand in operands])
    return None if known is None else np.broadcast_to(known.values, result.shape)


def _wide(equation: Any, operands: Sequence[Any], whole: Callable[[], Array]) -> Any:
    """A large array, written out only if it must be; None if that is not looked at."""
    name = equation.primitive.name
    if name == "broadcast_in_dim":
        return _moved(equation, operands[0], equation.params["broadcast_dimensions"], whole)
    if name == "transpose" and isinstance(operands[0], _Wide):
        back = np.argsort(equation.params["permutation"]).tolist()
        return _moved(equation, operands[0], back, whole)
    known = known_result(equation, [_known(operand) for operand in operands])
    if known is None:
        return None
    if known.is_constant:
        shape = equation.outvars[0].aval.shape
        return _constant_array(np.broadcast_to(known.values, shape), whole)
    return _elementwise(equation, operands, known, whole)


def _moved(equation: Any, operand: Any, places: Sequence[int], whole: Callable[[], Array]) -> _Wide:
    """An array of an operand's entries.

    Args:
      equation: of the operation.
      operand: of which it is made.
      places: where each axis of the operand is among those of the result.
      whole: how the program computes it.
    """
    known = known_move(equation, [_known(operand)])
    assert known is not None  # it is an operation that moves

    def some(entries: Entries, seen: dict[int, Any]) -> Any:
        axes = tuple(entries.axes[place] for place in places)
        moves = tuple(entries.moves[place] for place in places)
        return _some(operand, Entries(axes, moves, entries.shape).within(operand.shape))

    return _Wide(tuple(equation.outvars[0].aval.shape), known, whole, some)


def _elementwise(
    equation: Any, operands: Sequence[Any], known: Known, whole: Callable[[], Array]
) -> _Wide:
    shape = tuple(equation.outvars[0].aval.shape)

    def some(entries: Entries, seen: dict[int, Any]) -> Any:
        parts = []
        for operand in operands:
            if isinstance(operand, _Wide) and operand.shape == shape:
                parts.append(operand.at(entries, seen))
            elif np.shape(operand) or isinstance(operand, _Wide):
                parts.append(_some(operand, entries.within(operand.shape)))
            else:
                parts.append(operand)
        sizes = np.broadcast_shapes(*(np.shape(part) for part in parts))
        types = [atom.aval for atom in equation.invars]
        # a number may be given to a choice as it is
        given = [
            part if not kind.ndim else jnp.broadcast_to(jnp.asarray(part, kind.dtype), sizes)
            for part, kind in zip(parts, types, strict=True)
        ]
        return bind(equation.primitive, equation.params, given)[0]

    return _Wide(shape, known, whole, some)


def _reduced(equation: Any, operand: _Wide) -> Any:
    """A reduction of what is not neutral; None if that is too much."""
    name, result = equation.primitive.name, equation.outvars[0].aval
    axes, neutral = tuple(equation.params["axes"]), NEUTRAL[name]
    shape, count = operand.shape, len(operand.shape)
    known = operand.known.over(shape)
    reduced = known_reduction(name, known, axes)
    if reduced.is_constant:
        return reduced.values.astype(result.dtype)
    kept = [axis for axis in range(count) if axis not in axes]
    sizes = [shape[axis] for axis in kept]
    where, values = (
        np.transpose(part, [*kept, *axes]).reshape(*sizes, -1)
        for part in (known.where, known.values)
    )
    needed = ~(where & (values == neutral))
    if name in ("reduce_or", "reduce_and"):
        # one absorbing element is enough
        absorbing = where & (values != neutral)
        is_absorbed = absorbing.any(axis=-1)
        needed[is_absorbed] = False
        needed[is_absorbed, absorbing.argmax(axis=-1)[is_absorbed]] = True
    most = int(needed.sum(axis=-1).max(initial=0))
    if most * _GATHERING > needed.shape[-1]:
        return None
    places = np.argsort(~needed, axis=-1, kind="stable")[..., :most]
    is_meant = np.take_along_axis(needed, places, axis=-1)
    taken: list[np.ndarray] = [np.zeros(0, int)] * count
    for number, axis in enumerate(kept):
        own = [1] * (len(kept) + 1)
        own[number] = -1
        taken[axis] = np.arange(shape[axis]).reshape(own)
    for axis, place in zip(axes, np.unravel_index(places, [shape[a] for a in axes]), strict=True):
        taken[axis] = shrunk(place)
    moves = tuple(axis in axes for axis in range(count))
    entries = Entries(tuple(taken), moves, (*sizes, most))
    some = jnp.broadcast_to(operand.at(entries, {}), entries.shape)
    if not np.all(is_meant):
        some = jnp.where(shrunk(is_meant), some, jnp.asarray(neutral, some.dtype))
    if most == 1:
        return some[..., 0]
    params = {**equation.params, "axes": (len(sizes),)}
    return bind(equation.primitive, params, [some])[0]
