"""Numbers that keep linear preconditions, such as a budget, for many states at once.

    (sum_{?a : asset} PRICE(?a) * buy(?a)) <= cash

Numbers that break one go to the nearest point of their box that keeps it, as they do under JAX
(`mdpo_rddl.planner.plans.linear_limits`). Comparisons about a single number narrow the box; those
that have numbers in common are kept in turn, until nothing moves. All is in 64 bit, since the
environment compares so: of an equality one number takes the last bits. Integers go back to whole
numbers.

The coefficients are read off the simulator in each state, since prices change. What is not linear
is left alone.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from mdpo_rddl.problem.implications import comparisons, fluents_of
from mdpo_rddl.simulator.simulator import Simulator, State

ActionsOf = Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]
"""Of numbers [D, K] and which replica each of K is of [K]: all action fluents [*shape, K]."""

Box = tuple[np.ndarray, np.ndarray]
"""The least and the largest values of numbers."""

# rounds of projections where comparisons have numbers in common, and of Newton's steps in each,
# which are at most as many as there are numbers and mostly three
_ROUNDS, _STEPS = 50, 30
# how far inside an inequality is aimed at, and what is no difference, of what is compared
_INSIDE, _CLOSE = 1e-9, 1e-11
# by so much of what is compared a linear expression is off what its coefficients say
_LINEAR = 1e-6
# numbers that are multiples of so small a power of two, of the largest, are added up exactly
_GRID_BITS = 40
# times that one number takes the rest of an equality: rounding leaves a last bit now and then
_CLOSINGS = 4


class LinearLimits:
    """Projects D numbers of each replica onto the preconditions that are linear in them.

    Attributes:
      is_needed: whether any precondition compares what may be linear.
    """

    def __init__(
        self,
        simulator: Simulator,
        preconditions: Sequence[Any],
        box: Box,
        is_integer: np.ndarray,
        names: Sequence[str],
    ) -> None:
        """Finds the comparisons.

        Args:
          simulator: of the problem.
          preconditions: pyRDDLGym's expressions.
          box: the least and the largest value of each number [D], infinite where there is none.
          is_integer: whether each is whole [D].
          names: of the action fluents that the numbers are, in their order.
        """
        model = simulator.problem.model
        self._simulator, self._box, self._is_integer = simulator, box, is_integer
        self._parts = [
            part
            for precondition in preconditions
            for part in comparisons(precondition, set(names))
            if part is not None and fluents_of(list(part.sides)) & set(names)
        ]
        self.is_needed = bool(self._parts)
        expressions, counts = [], []
        for part in self._parts:
            scope = [
                (name, len(model.type_to_objects[kind])) for name, kind in part.variables.items()
            ]
            counts.append(math.prod(number for _, number in scope))
            expressions += [(side, scope) for side in part.sides]
            expressions += [(guard, scope[:depth]) for guard, _, depth in part.guards]
        self._values = simulator.values_of(expressions)
        exact = [part.operator == "==" for part in self._parts]
        # of each comparison, for each tuple of its objects [R, 1]
        self._is_exact = np.repeat(exact, counts)[:, np.newaxis]

    def __call__(self, numbers: np.ndarray, actions: ActionsOf, state: State) -> np.ndarray:
        """The numbers [D, B] at the nearest point, where there is one and all is linear.

        Args:
          numbers: as proposed [D, B].
          actions: with such numbers.
          state: all fluents [*shape, B].
        """
        size = len(numbers)
        lower, upper = (end[:, np.newaxis] for end in self._box)
        # what is read off numbers with few bits is exact, if the coefficients have few
        first = _on_grid(np.clip(numbers, lower, upper), (lower, upper))
        # one more of each number by itself, and of all together, by unequal amounts
        together = 1.0 + np.arange(size)[:, np.newaxis] % 3
        moves = np.concatenate([np.zeros((size, 1)), np.eye(size), together], axis=1)
        excess, weight, asked = self._rows(
            first[:, np.newaxis, :] + moves[:, :, np.newaxis], actions, state
        )
        slopes = excess[:, 1:-1] - excess[:, :1]  # [R, D, B]
        slopes[np.abs(slopes) <= _INSIDE * weight[:, :1]] = 0.0
        predicted = excess[:, 0] + np.einsum("rdb,dc->rb", slopes, together)
        # what a state does not ask for, or is not linear, is no row of that replica
        counts = asked[:, 0] & np.isfinite(excess).all(axis=1)
        counts &= np.abs(excess[:, -1] - predicted) <= _LINEAR * weight[:, -1]
        slopes = np.where(counts[:, np.newaxis], slopes, 0.0)
        constant = np.where(counts, excess[:, 0] - np.einsum("rdb,db->rb", slopes, first), 0.0)
        box = self._narrowed(slopes, constant)
        inside = np.where(self._is_exact, 0.0, _INSIDE * weight[:, 0])
        rows = slopes, constant + inside, weight[:, 0]
        nearest = self._rounded(self._projected(np.clip(first, *box), *rows, box), slopes, box)
        for _ in range(_CLOSINGS):
            left = self._rows(nearest[:, np.newaxis, :], actions, state)[0][:, 0]
            left = np.where(counts & self._is_exact, left, 0.0)
            if not left.any():
                break
            nearest = self._closed(nearest, slopes, left, box)
        return nearest

    def _rows(
        self, numbers: np.ndarray, actions: ActionsOf, state: State
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The left sides minus the right ones, their sizes, and which are asked for [R, K, B].

        Args:
          numbers: [D, K, B].
          state: all fluents [*shape, B].
        """
        size, ways, count = numbers.shape
        which, flat = np.tile(np.arange(count), ways), numbers.reshape(size, ways * count)
        found: list[tuple[np.ndarray, ...]] = []
        for begin in range(0, ways * count, self._simulator.block):
            some = slice(begin, begin + self._simulator.block)
            own = {name: value[..., which[some]] for name, value in state.items()}
            values = iter(self._values(own, actions(flat[:, some], which[some])))
            found.append(self._compared(values))
        joined = (np.concatenate(each, axis=-1) for each in zip(*found, strict=True))
        excess, weight, asked = (each.reshape(-1, ways, count) for each in joined)
        return excess, weight, asked

    def _compared(self, values: Iterator[np.ndarray]) -> tuple[np.ndarray, ...]:
        rows = []
        for part in self._parts:
            left, right = (next(values).astype(float) for _ in part.sides)
            asked = np.ones(left.shape, bool)
            for _, truth, depth in part.guards:
                guard = (next(values) != 0) == truth
                rest = (1,) * (left.ndim - 1 - depth)
                asked &= guard.reshape(*guard.shape[:-1], *rest, guard.shape[-1])
            weight = 1.0 + np.abs(left) + np.abs(right)
            each = part.sign * left - right, weight, asked
            rows.append([np.reshape(value, (-1, left.shape[-1])) for value in each])
        return tuple(np.concatenate(each) for each in zip(*rows, strict=True))

    def _narrowed(self, slopes: np.ndarray, constant: np.ndarray) -> Box:
        """The box that comparisons of a single number leave [D, B]."""
        shape = slopes.shape[1:]
        lower, upper = (np.repeat(end[:, np.newaxis], shape[1], axis=1) for end in self._box)
        widest = lower.copy(), upper.copy()
        for row in np.flatnonzero(self._are_single(slopes)):
            place = int(np.argmax(np.any(slopes[row], axis=1)))
            slope, is_exact = slopes[row, place], self._is_exact[row, 0]
            end = -constant[row] / np.where(slope == 0.0, 1.0, slope)
            least = np.where((slope < 0.0) | ((slope != 0.0) & is_exact), end, -np.inf)
            most = np.where((slope > 0.0) | ((slope != 0.0) & is_exact), end, np.inf)
            lower[place] = np.maximum(lower[place], least)
            upper[place] = np.minimum(upper[place], most)
        whole = self._is_integer[:, np.newaxis]
        # reals keep away from what is only computed, if there is room
        margin = _INSIDE * (1.0 + np.minimum(np.abs(lower), np.abs(upper)))
        margin = np.where(whole | (upper - lower < 2.0 * margin), 0.0, margin)
        lower = np.where(lower > widest[0], lower + margin, lower)
        upper = np.where(upper < widest[1], upper - margin, upper)
        return (
            np.where(whole, np.ceil(lower - _LINEAR), lower),
            np.where(whole, np.floor(upper + _LINEAR), upper),
        )

    @staticmethod
    def _are_single(slopes: np.ndarray) -> np.ndarray:
        """Which rows are about one number [R]."""
        return np.count_nonzero(np.any(slopes, axis=2), axis=1) == 1

    def _projected(
        self,
        numbers: np.ndarray,
        slopes: np.ndarray,
        constant: np.ndarray,
        weight: np.ndarray,
        box: Box,
    ) -> np.ndarray:
        """Numbers in the box with slopes . x + constant <= 0, or == 0 [D, B]."""
        reads = np.any(slopes, axis=2) & ~self._are_single(slopes)[:, np.newaxis]
        blocks = [
            (slopes[rows], constant[rows], self._is_exact[rows], weight[rows], box)
            for rows in self._apart(reads)
        ]
        x = numbers
        for _ in range(_ROUNDS if len(blocks) > 1 else 1):
            before = x
            for block in blocks:
                x = self._onto(x, *block)
            if np.all(np.abs(x - before) <= _CLOSE * (1.0 + np.abs(x))):
                break
        return x

    def _onto(
        self,
        start: np.ndarray,
        slopes: np.ndarray,
        constant: np.ndarray,
        is_exact: np.ndarray,
        weight: np.ndarray,
        box: Box,
    ) -> np.ndarray:
        """The nearest numbers in the box that keep rows which have none in common [D, B].

        Each row's numbers go by a multiple of their coefficients. Seen from the box, what is too
        much is a convex function of the multiple, which Newton's steps therefore do not overshoot.
        """
        lower, upper = box
        x, multiple = start, np.zeros(constant.shape)
        for _ in range(_STEPS):
            over = np.einsum("rdb,db->rb", slopes, x) + constant
            over = np.where(is_exact, over, np.maximum(over, 0.0))
            over[np.abs(over) <= _CLOSE * weight] = 0.0
            if not over.any():
                break
            down = slopes * over[:, np.newaxis]
            free = ((down > 0.0) & (x > lower)) | ((down < 0.0) & (x < upper))
            squares = np.einsum("rdb,rdb,rdb->rb", slopes, slopes, free)
            multiple += np.divide(over, squares, out=np.zeros(over.shape), where=squares > 0.0)
            x = np.clip(start - np.einsum("rdb,rb->db", slopes, multiple), lower, upper)
        return x

    @staticmethod
    def _apart(reads: np.ndarray) -> list[np.ndarray]:
        """Rows in blocks that have no numbers in common, of which rows read [R, D]."""
        blocks: list[list[int]] = []
        taken: list[np.ndarray] = []
        for row in np.flatnonzero(reads.any(axis=1)).tolist():
            fits = [n for n, each in enumerate(taken) if not np.any(each & reads[row])]
            if fits:
                blocks[fits[0]].append(row)
                taken[fits[0]] = taken[fits[0]] | reads[row]
            else:
                blocks.append([row])
                taken.append(reads[row].copy())
        return [np.array(block) for block in blocks]

    def _rounded(self, numbers: np.ndarray, slopes: np.ndarray, box: Box) -> np.ndarray:
        """Reals with few bits, and whole integers, which take less of what is limited [D, B]."""
        # what the projection has left off a whole number is none
        down, up = np.floor(numbers + _LINEAR), np.ceil(numbers - _LINEAR)
        whole = np.clip(np.where(slopes.sum(axis=0) > 0.0, down, up), *box)
        return np.where(self._is_integer[:, np.newaxis], whole, _on_grid(numbers, box))

    def _closed(
        self, numbers: np.ndarray, slopes: np.ndarray, left: np.ndarray, box: Box
    ) -> np.ndarray:
        """The numbers [D, B], of which for each equality the one with most room takes the rest."""
        lower, upper = box
        each, used = np.arange(numbers.shape[1]), np.zeros(numbers.shape, bool)
        for row in np.flatnonzero(left.any(axis=1)):
            own = slopes[row]
            with np.errstate(divide="ignore", invalid="ignore"):
                wanted = numbers - left[row] / own
            room = np.minimum(wanted - lower, upper - wanted)
            room = np.where((own == 0.0) | used, -1.0, np.minimum(room, 1.0))
            # integers that cannot take it whole leave it to others
            whole = wanted == np.rint(wanted)
            room = np.where(self._is_integer[:, np.newaxis] & ~whole, -1.0, room)
            place = np.argmax(room, axis=0)
            moving = (left[row] != 0.0) & (room[place, each] >= 0.0)
            numbers = numbers.copy()
            numbers[place[moving], each[moving]] = wanted[place[moving], each[moving]]
            used |= own != 0.0
        return numbers


def _on_grid(numbers: np.ndarray, box: Box) -> np.ndarray:
    """Numbers inside their box as multiples of a power of two, of each replica's largest [D, B]."""
    lower, upper = box
    largest = np.max(np.abs(numbers), axis=0, initial=1.0)
    unit = 2.0 ** (np.ceil(np.log2(largest)) - _GRID_BITS)
    rounded = np.rint(numbers / unit) * unit
    return np.where((rounded > lower) & (rounded < upper), rounded, numbers)
