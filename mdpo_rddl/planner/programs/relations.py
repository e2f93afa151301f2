"""Reductions over pairs of objects of which few are related: computed for those alone.

RDDL says over all objects what concerns a few, `exists_{?j} [CONNECTED(?i, ?j) ^ on(?j)]`. The
relation is a non-fluent, so it is known ahead which pairs leave the result as it is, whatever the
state: here these are left out, and the others are gathered.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, core
from jax.extend.core import ClosedJaxpr

from mdpo_rddl.planner.programs.gathering import Entries, gathered, shrunk
from mdpo_rddl.planner.programs.known import NEUTRAL, REDUCED, Known, known_result, moved
from mdpo_rddl.planner.programs.traced import CALLS, bind, called, replay

# smaller arrays are computed as they are written; larger ones are not looked at
_WORTH_ENTRIES, _MOST_ENTRIES = 200, 2 * 10**6
# so many entries as they are written take as long as one that is gathered, about
_GATHERING = 8


class _Wide:
    """A large array that is written out only if it must be.

    Attributes:
      known: what is known of it.
      shape: of the whole.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        known: Known,
        whole: Callable[[], Array],
        some: Callable[[Entries, dict[int, Any]], Any] | None = None,
    ) -> None:
        """Computes nothing yet.

        Args:
          shape: of the whole.
          known: what is known of it.
          whole: how the program computes it.
          some: computes entries of it, of a shape that is broadcast to theirs; what has been
            computed of other arrays at the same entries is kept. None if all of it is known.
        """
        self.shape, self.known = shape, known
        self._write, self._some = whole, some
        self._whole: Any = None

    @property
    def whole(self) -> Any:
        """All of it."""
        if self._whole is None:
            self._whole = self._write()
        return self._whole

    def at(self, entries: Entries, seen: dict[int, Any]) -> Any:
        """Some entries of it."""
        if self._some is None:
            return self.known.values[entries.axes]
        if id(self) not in seen:
            seen[id(self)] = self._some(entries, seen)
        return seen[id(self)]


def among_related(closed: ClosedJaxpr) -> ClosedJaxpr:
    """A program with the same results, in which reductions leave out what cannot change them.

    Results agree up to the order of floating-point operations. What is known are the program's
    constants. A program without large reductions is returned as it is.
    """
    if not _has_large_reductions(closed.jaxpr):
        return closed
    inputs = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in closed.jaxpr.invars]
    return jax.make_jaxpr(lambda *values: [_whole(v) for v in replay(closed, values, _apply)])(
        *inputs
    )


def _has_large_reductions(jaxpr: Any) -> bool:
    for equation in jaxpr.eqns:
        if equation.primitive.name in CALLS:
            if _has_large_reductions(called(equation).jaxpr):
                return True
        elif equation.primitive.name in NEUTRAL and _is_large(equation.invars[0].aval):
            return True
    return False


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


def _settled(values: np.ndarray, whole: Callable[[], Array]) -> Any:
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
        return [values if name in NEUTRAL else _settled(values, lambda: plain()[0])]
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
    name, params = equation.primitive.name, equation.params
    if name == "broadcast_in_dim":
        return _broadcast(operands[0], params, whole)
    if name == "transpose" and isinstance(operands[0], _Wide):
        return _transposed(operands[0], params["permutation"], whole)
    known = known_result(equation, [_known(operand) for operand in operands])
    if known is None:
        return None
    if known.is_constant:
        shape = equation.outvars[0].aval.shape
        return _settled(np.broadcast_to(known.values, shape), whole)
    return _elementwise(equation, operands, known, whole)


def _broadcast(operand: Any, params: dict[str, Any], whole: Callable[[], Array]) -> Any:
    shape, places = tuple(params["shape"]), tuple(params["broadcast_dimensions"])

    def spread(values: Any) -> Any:
        sizes = [1] * len(shape)
        for axis, place in enumerate(places):
            sizes[place] = np.shape(values)[axis]
        return np.broadcast_to(np.reshape(values, sizes), shape)

    known, sizes = _known(operand), operand.shape
    if isinstance(operand, _Wide):
        parts = [np.broadcast_to(part, sizes) for part in (known.values, known.where)]
        known = Known(spread(parts[0]), spread(parts[1]), known.is_finite)

    def some(entries: Entries, seen: dict[int, Any]) -> Any:
        axes = tuple(entries.axes[place] for place in places)
        moves = tuple(entries.moves[place] for place in places)
        return _some(operand, Entries(axes, moves, entries.shape).within(sizes))

    return _Wide(shape, known, whole, some)


def _transposed(operand: _Wide, permutation: Sequence[int], whole: Callable[[], Array]) -> _Wide:
    wide = [
        np.transpose(np.broadcast_to(part, operand.shape), permutation)
        for part in (operand.known.values, operand.known.where)
    ]
    shape = tuple(operand.shape[axis] for axis in permutation)

    def some(entries: Entries, seen: dict[int, Any]) -> Any:
        back = np.argsort(permutation).tolist()
        axes = tuple(entries.axes[place] for place in back)
        moves = tuple(entries.moves[place] for place in back)
        return _some(operand, Entries(axes, moves, entries.shape))

    return _Wide(shape, Known(wide[0], wide[1], operand.known.is_finite), whole, some)


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
    known = operand.known
    shape, count = operand.shape, len(operand.shape)
    kept = [axis for axis in range(count) if axis not in axes]
    sizes = [shape[axis] for axis in kept]

    def ordered(each: np.ndarray) -> np.ndarray:
        rows = np.transpose(np.broadcast_to(each, shape), [*kept, *axes])
        return rows.reshape(*sizes, -1)

    where, values = ordered(known.where), ordered(known.values)
    counts = ~(where & (values == neutral))
    if name in ("reduce_or", "reduce_and"):
        # one that settles it is enough
        settles = where & (values != neutral)
        is_settled = settles.any(axis=-1)
        counts[is_settled] = False
        counts[is_settled, settles.argmax(axis=-1)[is_settled]] = True
    most = int(counts.sum(axis=-1).max(initial=0))
    if not np.any(counts & ~where):
        found = np.where(counts, values, neutral)
        return REDUCED[name](found, axis=-1).astype(result.dtype)
    if most * _GATHERING > counts.shape[-1]:
        return None
    places = np.argsort(~counts, axis=-1, kind="stable")[..., :most]
    is_meant = np.take_along_axis(counts, places, axis=-1)
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
