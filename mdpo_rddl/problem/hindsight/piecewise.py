"""Functions of one variable that are linear between breakpoints.

Nested conditions on one fluent, such as a cost below one level and another above another one,
are such functions. Written as a whole they cost a linear program as little as possible: what it
takes for the function without its switches is exactly the convex hull of the function's graph.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mdpo_rddl.problem.hindsight.program import Affine, Program, Value

# pieces between points and the points; and values that are as good as without bounds
_MOST_PIECES, _FAR = 64, 1e9


class Piece(NamedTuple):
    """A part of a function: constant + slope * x between two values of x, or at one.

    The ends belong to pieces of their own, [x, x], so that a condition may hold there alone.
    """

    start: float
    end: float
    constant: float
    slope: float

    def at(self, x: float) -> float:
        """The value there."""
        return self.constant + self.slope * x

    @property
    def is_point(self) -> bool:
        """Whether it is a single value of x."""
        return self.start == self.end


@dataclass(frozen=True)
class Piecewise:
    """A function of one variable.

    Attributes:
      variable: number of the variable.
      pieces: in order: a point, what is between it and the next one, that point, and so on.
      is_bool: whether the values are 0 and 1.
    """

    variable: int
    pieces: tuple[Piece, ...]
    is_bool: bool = False

    def written(self, program: Program) -> Value:
        """The function's value in a linear program; at a jump it is one of either side's."""
        pieces = [
            piece
            for number, piece in enumerate(self.pieces)
            if not piece.is_point or not self._continues(number)
        ]
        if len(pieces) == 1:
            constant, slope = pieces[0].constant, pieces[0].slope
            if slope == 0.0:
                return bool(constant) if self.is_bool else constant
            return Affine(constant, {self.variable: slope}, self.is_bool)
        value, x = Affine(0.0, {}), Affine(0.0, {self.variable: -1.0})
        chosen = Affine(0.0, {})
        for piece in pieces:
            is_here = program.switch()
            inside = program.variable(min(piece.start, 0.0), max(piece.end, 0.0))
            program.require(inside - piece.start * is_here, lower=0.0)
            program.require(inside - piece.end * is_here, upper=0.0)
            value = value + piece.constant * is_here + piece.slope * inside
            chosen, x = chosen + is_here, x + inside
        program.require(chosen, 1.0, 1.0)
        program.require(x, 0.0, 0.0)
        ends = [piece.at(end) for piece in pieces for end in (piece.start, piece.end)]
        named = program.variable(min(ends), max(ends))
        program.require(named - value, 0.0, 0.0)
        return Affine(named.constant, named.terms, self.is_bool)

    def _continues(self, number: int) -> bool:
        """Whether a point has the value that a neighbour ends with."""
        x, value = self.pieces[number].start, self.pieces[number].constant
        beside = self.pieces[max(0, number - 1) : number + 2]
        return any(is_close(piece.at(x), value) for piece in beside if not piece.is_point)


def as_functions(
    program: Program, arguments: Sequence["Value | Piecewise"]
) -> tuple[int, list[tuple[Piece, ...]]] | None:
    """The arguments as functions of one variable, if they are.

    Returns:
      The variable, and of each argument pieces, those of all arguments with the same ends; None
      if there are several variables, or one without bounds.
    """
    variables = set()
    for each in arguments:
        if isinstance(each, Piecewise):
            variables.add(each.variable)
        elif isinstance(each, Affine):
            variables |= set(each.terms)
    if len(variables) != 1:
        return None
    variable = variables.pop()
    start, end = program.interval(Affine(0.0, {variable: 1.0}))
    if not -_FAR < start < end < _FAR:
        return None
    divided = [each.pieces for each in arguments if isinstance(each, Piecewise)]
    ends = sorted({start, end, *(piece.end for pieces in divided for piece in pieces)})
    functions: list[tuple[Piece, ...]] = []
    for each in arguments:
        if isinstance(each, Piecewise):
            functions.append(_divided(each.pieces, ends))
        elif isinstance(each, Affine):
            line = Piece(start, end, each.constant, each.terms[variable])
            functions.append(_divided([line], ends))
        else:
            functions.append(_divided([Piece(start, end, float(each), 0.0)], ends))
    return variable, functions


def combined(
    variable: int,
    functions: Sequence[tuple[Piece, ...]],
    rule: Callable[..., tuple[float, float]],
    is_bool: bool = False,
) -> Piecewise | None:
    """A function of functions.

    Args:
      variable: of all of them.
      functions: as of `as_functions`.
      rule: gives the constant and the slope of the result, of the arguments' pieces where no two
        of them cross, or at a point.
      is_bool: whether the result is 0 or 1.

    Returns:
      None if the function has too many pieces.
    """
    pieces: list[Piece] = []
    for parts in zip(*functions, strict=True):
        start, end = parts[0].start, parts[0].end
        cuts = {x for a in parts for b in parts if start < (x := _crossing(a, b)) < end}
        edges = [start, *sorted(cuts), end]
        for number, (low, high) in enumerate(itertools.pairwise(edges)):
            if number:
                pieces.append(_ruled(rule, parts, low, low))
            pieces.append(_ruled(rule, parts, low, high))
    joined = _joined(pieces)
    return Piecewise(variable, joined, is_bool) if len(joined) <= _MOST_PIECES else None


def is_close(first: float, second: float) -> bool:
    """Whether two values are the same but for rounding."""
    return math.isclose(first, second, rel_tol=1e-9, abs_tol=1e-9)


def _ruled(
    rule: Callable[..., tuple[float, float]], parts: Sequence[Piece], low: float, high: float
) -> Piece:
    constant, slope = rule(*(Piece(low, high, part.constant, part.slope) for part in parts))
    if low == high:
        return Piece(low, high, constant + slope * low, 0.0)
    return Piece(low, high, constant, slope)


def _crossing(first: Piece, second: Piece) -> float:
    """Where two lines meet; infinity if they never do."""
    slope = first.slope - second.slope
    return (second.constant - first.constant) / slope if slope else math.inf


def _divided(pieces: Sequence[Piece], ends: Sequence[float]) -> tuple[Piece, ...]:
    """The pieces, cut at the ends, each of which becomes a point."""
    points = {piece.start: piece.constant for piece in pieces if piece.is_point}
    divided: list[Piece] = []
    for piece in pieces:
        if piece.is_point:
            continue
        inside = [end for end in ends if piece.start <= end <= piece.end]
        for low, high in itertools.pairwise(inside):
            point = Piece(low, low, points.get(low, piece.at(low)), 0.0)
            divided += [point, Piece(low, high, piece.constant, piece.slope)]
        last = inside[-1]
    divided.append(Piece(last, last, points.get(last, divided[-1].at(last)), 0.0))
    return tuple(divided)


def _joined(pieces: Sequence[Piece]) -> tuple[Piece, ...]:
    """The pieces, neighbours on one line as one."""
    joined: list[Piece] = []
    for piece in pieces:
        if len(joined) >= 2 and not piece.is_point:
            before, point = joined[-2:]
            is_one = (before.constant, before.slope) == (piece.constant, piece.slope)
            if is_one and not before.is_point and is_close(piece.at(point.start), point.constant):
                joined[-2:] = [before._replace(end=piece.end)]
                continue
        joined.append(piece)
    return tuple(joined)
