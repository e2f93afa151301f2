"""Which entries of a program's results depend on which of some switches, whatever it is given."""

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from jax.extend.core import ClosedJaxpr, Literal

from mdpo_rddl.planner.programs.known import (
    REDUCED,
    Known,
    known_move,
    known_reduction,
    known_result,
    moved,
)
from mdpo_rddl.planner.programs.traced import CALLS, ELEMENTWISE, called

# of which entries depend on all that they are made of; of some nothing is known
_REDUCTIONS = (*REDUCED, "reduce_max", "reduce_min", "argmax", "argmin")
# of one array, over all switches
_MOST_ENTRIES = 4 * 10**6


class _Value(NamedTuple):
    """What is known of an array, and which switches each entry depends on [S, *shape], if any."""

    known: Known
    on: np.ndarray | None


def dependence(
    closed: ClosedJaxpr, given: Sequence[np.ndarray | None], switches: int
) -> list[np.ndarray]:
    """Which switches each entry of each result may depend on.

    Read off the operations and the program's constants: an entry that does not depend on a switch
    here does not in any state. One that does here need not: of operations that are not looked
    into, every entry depends on all that any operand does.

    Args:
      closed: the program.
      given: per argument which switches each entry depends on [S, *shape]; None for none.
      switches: how many there are, S.

    Returns:
      Per result [S, *shape].
    """
    inputs = [
        _Value(Known.nothing(variable.aval.dtype), on)
        for variable, on in zip(closed.jaxpr.invars, given, strict=True)
    ]
    found = _run(closed, inputs, switches)
    shapes = [atom.aval.shape for atom in closed.jaxpr.outvars]
    nothing = [np.zeros((switches, *shape), bool) for shape in shapes]
    return [no if v.on is None else v.on for v, no in zip(found, nothing, strict=True)]


def _run(closed: ClosedJaxpr, inputs: Sequence[_Value], switches: int) -> list[_Value]:
    jaxpr = closed.jaxpr
    values = {
        variable: _Value(Known.all_of(constant), None)
        if isinstance(variable.aval.dtype, np.dtype)
        else _Value(Known.nothing(variable.aval.dtype), None)
        for variable, constant in zip(jaxpr.constvars, closed.consts, strict=True)
    }
    values.update(zip(jaxpr.invars, inputs, strict=True))

    def read(atom: Any) -> _Value:
        if isinstance(atom, Literal):
            return _Value(Known.all_of(atom.val), None)
        return values[atom]

    for equation in jaxpr.eqns:
        operands = [read(atom) for atom in equation.invars]
        if equation.primitive.name in CALLS:
            results = _run(called(equation), operands, switches)
        elif len(equation.outvars) == 1:
            results = [_applied(equation, operands, switches)]
        else:
            results = _mixed(equation, operands, switches)
        values.update(zip(equation.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _applied(equation: Any, operands: Sequence[_Value], switches: int) -> _Value:
    name, result = equation.primitive.name, equation.outvars[0].aval
    shapes = [atom.aval.shape for atom in equation.invars]
    if switches * max(result.size, *(int(np.prod(shape)) for shape in shapes), 0) > _MOST_ENTRIES:
        return _mixed(equation, operands, switches)[0]
    if not isinstance(result.dtype, np.dtype):
        return _mixed(equation, operands, switches)[0]
    known = [value.known for value in operands]
    if name in _REDUCTIONS:
        axes, found = tuple(equation.params["axes"]), Known.nothing(result.dtype)
        if name in REDUCED:
            found = known_reduction(name, known[0].over(shapes[0]), axes)
        on = operands[0].on
        on = None if on is None else np.any(on, axis=tuple(1 + axis for axis in axes))
        return _Value(found, _where_unknown(on, found))
    if name in ELEMENTWISE:
        found = known_result(equation, known) or Known.nothing(result.dtype)
        parts = [_aligned(value.on, result.ndim) for value in operands if value.on is not None]
        on = reduce(np.logical_or, parts) if parts else None
        if name == "select_n" and known[0].where.any():
            on = _of_choice(equation, operands, switches)
        on = None if on is None else np.broadcast_to(on, (switches, *result.shape))
        return _Value(found, _where_unknown(on, found))
    there = known_move(equation, known)
    if there is None:
        return _mixed(equation, operands, switches)[0]
    on = None
    if any(value.on is not None for value in operands):
        ons = [
            np.zeros((switches, *shape), bool) if value.on is None else value.on
            for value, shape in zip(operands, shapes, strict=True)
        ]
        on = moved(equation, ons, lead=1)
    return _Value(there, on)


def _of_choice(equation: Any, operands: Sequence[_Value], switches: int) -> np.ndarray:
    """Of a choice between cases: where it is known which, only that one counts."""
    shape = equation.outvars[0].aval.shape
    asked = operands[0].known
    ons = [
        np.zeros((switches, *shape), bool)
        if value.on is None
        else np.broadcast_to(_aligned(value.on, len(shape)), (switches, *shape))
        for value in operands
    ]
    if len(operands) != 3 or equation.invars[0].aval.dtype != np.bool_:
        return reduce(np.logical_or, ons)
    either = ons[0] | ons[1] | ons[2]
    one = np.where(asked.values, ons[2], ons[1])
    return np.where(asked.where, one, either)


def _mixed(equation: Any, operands: Sequence[_Value], switches: int) -> list[_Value]:
    """Of an operation that is not looked into: all depends on whatever any operand does."""
    ons = [
        np.any(value.on, axis=tuple(range(1, value.on.ndim)))
        for value in operands
        if value.on is not None
    ]
    results = []
    for variable in equation.outvars:
        shape, on = variable.aval.shape, None
        if ons:
            every = reduce(np.logical_or, ons).reshape(switches, *[1] * len(shape))
            on = np.broadcast_to(every, (switches, *shape))
        results.append(_Value(Known.nothing(variable.aval.dtype), on))
    return results


def _aligned(on: np.ndarray, count: int) -> np.ndarray:
    """With so many axes after the first: a number is given to all entries."""
    return on.reshape(on.shape[0], *[1] * (count + 1 - on.ndim), *on.shape[1:])


def _where_unknown(on: np.ndarray | None, known: Known) -> np.ndarray | None:
    """On which switches entries depend: none where the entry is known."""
    if on is None or not known.where.any():
        return on
    return on & ~np.broadcast_to(known.where, on.shape[1:])
