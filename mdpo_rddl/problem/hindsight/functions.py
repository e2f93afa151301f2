"""RDDL's operators on functions of one variable, piece by piece."""

from collections.abc import Callable, Sequence

from mdpo_rddl.problem.enumeration.operators import BOOL_OPERATORS
from mdpo_rddl.problem.hindsight.piecewise import Piece, Piecewise, as_functions, combined, is_close
from mdpo_rddl.problem.hindsight.program import Affine, Program, Value

Line = tuple[float, float]
"""Constant and slope."""


def function_of_one(
    program: Program, operator: str, arguments: Sequence[Value | Piecewise]
) -> Piecewise | None:
    """An operator's result as a function of one variable; None if it is no such function.

    Args:
      program: that has the variable.
      operator: of `mdpo_rddl.problem.enumeration.operators`.
      arguments: it is applied to.
    """
    rule = _RULES.get(operator)
    if rule is None:
        return None
    if operator == "abs":
        # so that it is cut where it is 0
        arguments = [*arguments, 0.0]
    functions = as_functions(program, arguments)
    if functions is None:
        return None
    is_bool = operator in BOOL_OPERATORS
    if operator == "if":
        is_bool = all(map(_is_bool, arguments[1:]))
    try:
        return combined(*functions, rule, is_bool)
    except _CurvedError:
        return None


class _CurvedError(Exception):
    """A result is not linear."""


def _is_bool(value: Value | Piecewise) -> bool:
    return value.is_bool if isinstance(value, (Affine, Piecewise)) else isinstance(value, bool)


def _at_least(first: Piece, second: Piece) -> Line:
    return _truth(_middle(first) >= _middle(second) or _are_equal(first, second))


def _more(first: Piece, second: Piece) -> Line:
    return _truth(_middle(first) > _middle(second) and not _are_equal(first, second))


def _equal(first: Piece, second: Piece) -> Line:
    return _truth(_are_equal(first, second))


def _different(first: Piece, second: Piece) -> Line:
    return _truth(not _are_equal(first, second))


def _are_equal(first: Piece, second: Piece) -> bool:
    """At a point: whether the values are; between points: whether the lines are."""
    if first.is_point:
        return is_close(_middle(first), _middle(second))
    return _line(first) == _line(second)


def _middle(piece: Piece) -> float:
    return piece.at(0.5 * (piece.start + piece.end))


def _line(piece: Piece) -> Line:
    return piece.constant, piece.slope


def _truth(holds: bool) -> Line:
    return float(holds), 0.0


def _sum(*parts: Piece) -> Line:
    return sum(part.constant for part in parts), sum(part.slope for part in parts)


def _product(*parts: Piece) -> Line:
    constant, slope = 1.0, 0.0
    for part in parts:
        if slope and part.slope:
            raise _CurvedError
        slope = slope * part.constant + constant * part.slope
        constant *= part.constant
    return constant, slope


def _quotient(first: Piece, second: Piece) -> Line:
    if second.slope or not second.constant:
        raise _CurvedError
    return first.constant / second.constant, first.slope / second.constant


def _difference(first: Piece, second: Piece) -> Line:
    return first.constant - second.constant, first.slope - second.slope


def _largest(*parts: Piece) -> Line:
    return _line(max(parts, key=_middle))


def _smallest(*parts: Piece) -> Line:
    return _line(min(parts, key=_middle))


def _absolute(part: Piece, zero: Piece) -> Line:
    return _line(part) if _middle(part) >= 0.0 else (-part.constant, -part.slope)


def _choice(condition: Piece, yes: Piece, no: Piece) -> Line:
    if condition.slope:
        raise _CurvedError
    return _line(yes if condition.constant else no)


_RULES: dict[str, Callable[..., Line]] = {
    "+": _sum,
    "-": _difference,
    "*": _product,
    "/": _quotient,
    "maximum": _largest,
    "max": _largest,
    "or": _largest,
    "minimum": _smallest,
    "min": _smallest,
    "and": _smallest,
    "abs": _absolute,
    "if": _choice,
    "not": lambda part: (1.0 - part.constant, -part.slope),
    ">=": _at_least,
    "<=": lambda x, y: _at_least(y, x),
    ">": _more,
    "<": lambda x, y: _more(y, x),
    "==": _equal,
    "iff": _equal,
    "~=": _different,
    "xor": _different,
}
