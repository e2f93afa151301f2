"""Real actions that keep linear preconditions to the last bit of 64.

A policy computes in 32 bits, and the environment compares in 64: three weights whose sum is to be 1
miss it by some 1e-8. Here as many numbers as there are equalities take the rest, and the others
stay, so that the environment's own evaluation of the preconditions, in its own order of summation,
finds them kept. What is farther off goes to the nearest point first.
"""

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.problem.implications import Comparison, comparisons, fluents_of, is_box

# how far into what an inequality allows a number is moved, of what is compared
_INSIDE, _STRICTLY_INSIDE = 1e-13, 1e-9
# of Newton's method, where last places are missing
_STEPS = 8
# numbers that are multiples of so small a power of two, of the largest, are added up exactly
_GRID_BITS = 40
# in units of the last place, what is tried around a number for an equality to hold
_NUDGES = (0, 1, -1, 2, -2, 3, -3)
# equalities for which that is done, what is tried for each, and how often all of it is tried, each
# time with numbers that are moved by a few units of that power of two
_MOST_TRIED, _MOST_TRIES = 5, 40
_ATTEMPTS, _MOVED_BY = 8, 8
_LEAST = 1e-9
# of what is compared, by what the nearest point may be off
_ROUNDING = 1e-11


class _Rows(NamedTuple):
    """The comparisons, for all objects one after the other [R].

    Attributes:
      excess: left side minus right side.
      size: of what is compared.
      is_asked: whether its guards hold.
    """

    excess: np.ndarray
    size: np.ndarray
    is_asked: np.ndarray


def has_equality(rddl: Any) -> bool:
    """Whether a precondition asks for real actions to be equal to something.

    Args:
      rddl: pyRDDLGym's lifted model.
    """
    reals = {name for name in rddl.action_fluents if rddl.variable_ranges[name] == "real"}
    return any(
        part is not None and part.operator == "==" and fluents_of(list(part.sides)) & reals
        for precondition in (rddl.preconditions if reals else ())
        for part in comparisons(precondition, reals)
    )


class LinearPreconditions:
    """The preconditions of an environment that compare what may be linear in D real actions.

    Attributes:
      is_needed: whether there are any.
    """

    def __init__(self, env: RDDLEnv, box: Mapping[str, tuple[Any, Any]]) -> None:
        """Finds them.

        Args:
          env: a vectorized environment, whose current state will count.
          box: lower and upper bound [*shape] of each real action fluent.
        """
        rddl, self._simulator = env.model, env.sampler
        names, shapes = box.keys(), {n: np.shape(env.sampler.noop_actions[n]) for n in box}
        self._shapes = shapes
        self._lower, self._upper = (
            _joined([np.broadcast_to(box[name][end], shapes[name]) for name in names])
            for end in range(2)
        )
        self._parts = [
            part
            for precondition in rddl.preconditions
            if not is_box(rddl, precondition)
            for part in comparisons(precondition, names)
            if part is not None and fluents_of(list(part.sides)) & names
        ]
        self._sizes = [
            [len(rddl.type_to_objects[kind]) for kind in part.variables.values()]
            for part in self._parts
        ]
        counts = [int(np.prod(sizes)) for sizes in self._sizes]
        self._is_exact, self._is_strict = (
            np.repeat([part.operator == operator for part in self._parts], counts)
            for operator in ("==", "<")
        )
        self.is_needed = bool(self._parts)

    def restored(self, actions: Mapping[str, Any]) -> dict[str, Any]:
        """Actions whose real ones are moved to keep the preconditions in the current state.

        Args:
          actions: per action fluent [*shape], all of them, each finite and of its kind.

        Returns:
          The same with other real ones. What is not linear, or has no solution near, may be broken
          as before.
        """
        given = _joined([np.asarray(actions[name], np.float64) for name in self._shapes])
        numbers = np.clip(given, self._lower, self._upper)
        slopes = self._slopes(numbers, actions)
        numbers = self._near(numbers, slopes, actions)
        for attempt in range(_ATTEMPTS):
            tried = self._closed(self._on_grid(numbers, attempt), slopes, actions)
            tried, errors = self._nudged(tried, slopes, actions)
            # what is not nearly kept has no solution near
            if not np.any(errors) or np.any(np.abs(errors) > _LEAST):
                break
        return {**actions, **self._reals(tried)}

    def _near(
        self, numbers: np.ndarray, slopes: np.ndarray, actions: Mapping[str, Any]
    ) -> np.ndarray:
        """The nearest numbers [D] that keep the rows up to rounding; the same ones if none do.

        A problem of least distance, as Lawson and Hanson solve it: equalities are eliminated, and
        inequalities are what a problem of least squares without negative numbers is dual to.

        Args:
          numbers: to begin with [D].
          slopes: of each row by each number [R, D].
          actions: the others.
        """
        from scipy import linalg, optimize  # take long to import, and few problems need them

        rows = self._rows(numbers, actions)
        asked = rows.is_asked & np.any(slopes, axis=1) & np.isfinite(rows.excess)
        equal, limited = asked & self._is_exact, asked & ~self._is_exact
        first = np.linalg.lstsq(slopes[equal], -rows.excess[equal], rcond=None)[0]
        free = linalg.null_space(slopes[equal]) if np.any(equal) else np.eye(len(numbers))
        limits = np.concatenate([-slopes[limited], np.eye(len(numbers)), -np.eye(len(numbers))])
        least = np.concatenate(
            [
                rows.excess[limited] - _ROUNDING * rows.size[limited],
                self._lower - numbers,
                numbers - self._upper,
            ]
        )
        limits, least = limits[np.isfinite(least)], least[np.isfinite(least)]
        least = least - limits @ first
        scale = np.max(least, initial=0.0)
        if scale <= _LEAST:
            return self._at_ends(numbers + first)
        system = np.concatenate([(limits @ free).T, least[np.newaxis] / scale])
        wanted = np.eye(len(system))[-1]
        *residual, last = wanted - system @ optimize.nnls(system, wanted)[0]
        if last <= _LEAST:
            return numbers
        change = first - scale / last * (free @ np.array(residual))
        return self._at_ends(numbers + change)

    def _at_ends(self, numbers: np.ndarray) -> np.ndarray:
        """The numbers [D] in their box, at its ends where they are next to them."""
        for end in (self._lower, self._upper):
            numbers = np.where(np.abs(numbers - end) <= _LEAST, end, numbers)
        return np.clip(numbers, self._lower, self._upper)

    def _closed(
        self, numbers: np.ndarray, slopes: np.ndarray, actions: Mapping[str, Any]
    ) -> np.ndarray:
        """The numbers [D], of which as many as rows are kept or broken take the rest."""
        from scipy import linalg  # as above

        was_broken = np.zeros(len(self._is_exact), bool)
        for _ in range(_STEPS):
            rows = self._rows(numbers, actions)
            errors = self._errors(rows)
            if not np.any(errors):
                break
            # what was broken once stays where it was moved to
            was_broken |= errors != 0.0
            active = (self._is_exact & rows.is_asked) | was_broken
            own = slopes[active]
            room = np.minimum(numbers - self._lower, self._upper - numbers)
            weighted = own * np.clip(room, _LEAST, 1.0)
            _, triangle, order = linalg.qr(weighted, mode="economic", pivoting=True)
            diagonal = np.abs(np.diag(triangle))
            taken = order[: np.count_nonzero(diagonal > _LEAST * np.max(diagonal, initial=0.0))]
            change = np.linalg.lstsq(own[:, taken], -errors[active], rcond=None)[0]
            numbers = numbers.copy()
            numbers[taken] += change
            numbers = np.clip(numbers, self._lower, self._upper)
            nearest = self._on_grid(numbers)
            is_near = np.abs(nearest - numbers) <= _INSIDE * (1.0 + np.abs(numbers))
            numbers = np.where(is_near, nearest, numbers)
        return numbers

    def _nudged(
        self, numbers: np.ndarray, slopes: np.ndarray, actions: Mapping[str, Any]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The numbers [D], single ones moved by units of the last place, and the errors [R]."""
        errors = self._errors(self._rows(numbers, actions))
        for row in np.flatnonzero(errors)[:_MOST_TRIED]:
            tries = self._tries(numbers, slopes[row], errors[row])
            for tried in islice(tries, _MOST_TRIES):
                left = self._errors(self._rows(tried, actions))
                if not left[row] and np.count_nonzero(left) < np.count_nonzero(errors):
                    numbers, errors = tried, left
                    break
        return numbers, errors

    def _tries(self, numbers: np.ndarray, slopes: np.ndarray, error: float) -> Iterator[np.ndarray]:
        """The numbers [D] of which one takes an error, and perhaps another one is moved a little.

        Args:
          numbers: to begin with [D].
          slopes: what a unit of each adds [D].
          error: of the row.
        """
        columns = np.flatnonzero(slopes)[::-1]
        for shift in _NUDGES:
            for column in columns:
                # where no last place fits, that of another number is moved too
                for other in columns[columns != column] if shift else [column]:
                    for nudge in _NUDGES:
                        tried = numbers.copy()
                        tried[other] += shift * np.spacing(tried[other])
                        moved = slopes[other] * (tried[other] - numbers[other])
                        tried[column] -= (error + moved) / slopes[column]
                        tried[column] += nudge * np.spacing(tried[column])
                        yield np.clip(tried, self._lower, self._upper)

    def _on_grid(self, numbers: np.ndarray, attempt: int = 0) -> np.ndarray:
        """The numbers [D] inside their box as multiples of a power of two.

        Args:
          numbers: to begin with [D].
          attempt: each after the first moves them by other few multiples.
        """
        largest = np.max(np.abs(numbers), initial=1.0)
        unit = 2.0 ** (np.ceil(np.log2(largest)) - _GRID_BITS)
        most = _MOVED_BY if attempt else 0
        moved = np.random.default_rng(attempt).integers(-most, most + 1, np.shape(numbers))
        rounded = (np.rint(numbers / unit) + moved) * unit
        is_inside = (rounded > self._lower) & (rounded < self._upper)
        return np.where(
            is_inside & (numbers > self._lower) & (numbers < self._upper), rounded, numbers
        )

    def _slopes(self, numbers: np.ndarray, actions: Mapping[str, Any]) -> np.ndarray:
        """What a unit of each number adds to each row's excess [R, D]."""
        first = self._rows(numbers, actions)
        columns = []
        for column in range(len(numbers)):
            moved = numbers.copy()
            moved[column] += 1.0
            columns.append(self._rows(moved, actions).excess - first.excess)
        slopes = np.stack(columns, axis=1)
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        return np.where(np.abs(slopes) <= _INSIDE * first.size[:, np.newaxis], 0.0, slopes)

    def _errors(self, rows: _Rows) -> np.ndarray:
        """How far each row is from where it should be [R]; 0 where it is kept."""
        excess = rows.excess
        inside = np.where(self._is_strict, _STRICTLY_INSIDE, 0.0) * rows.size
        is_broken = np.where(self._is_strict, excess >= 0.0, excess > 0.0)
        errors = np.where(self._is_exact, excess, np.where(is_broken, excess + inside, 0.0))
        return np.where(rows.is_asked & np.isfinite(errors), errors, 0.0)

    def _rows(self, numbers: np.ndarray, actions: Mapping[str, Any]) -> _Rows:
        fluents = {**self._simulator.subs, **actions, **self._reals(numbers)}
        each = [
            self._row(part, sizes, fluents)
            for part, sizes in zip(self._parts, self._sizes, strict=True)
        ]
        return _Rows(*(_joined(list(values)) for values in zip(*each, strict=True)))

    def _row(self, part: Comparison, sizes: list[int], fluents: dict[str, Any]) -> _Rows:
        left, right = (
            np.asarray(self._simulator._sample(side, fluents), np.float64) for side in part.sides
        )
        asked = np.ones(sizes, bool)
        for guard, truth, scope in part.guards:
            value = np.asarray(self._simulator._sample(guard, fluents), bool) == truth
            value = np.broadcast_to(value, sizes[:scope])
            asked &= np.reshape(value, sizes[:scope] + [1] * (len(sizes) - scope))
        size = 1.0 + np.abs(left) + np.abs(right)
        return _Rows(
            np.broadcast_to(part.sign * left - right, sizes), np.broadcast_to(size, sizes), asked
        )

    def _reals(self, numbers: np.ndarray) -> dict[str, Any]:
        """The numbers [D] per action fluent [*shape]."""
        found, start = {}, 0
        for name, shape in self._shapes.items():
            size = int(np.prod(shape))
            found[name] = np.reshape(numbers[start : start + size], shape)
            start += size
        return {name: value if value.shape else value.item() for name, value in found.items()}


def _joined(values: list[Any]) -> np.ndarray:
    return np.concatenate([np.ravel(value) for value in values]) if values else np.zeros(0)
