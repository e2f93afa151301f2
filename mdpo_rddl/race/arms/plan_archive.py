"""Going where no plan has been: for problems in which a reward must first be found.

An archive keeps, for each cell of the state space that was ever visited, a way there in few steps;
episodes go on from there with random actions. That is Go-Explore, Ecoffet et al. (2021),
https://arxiv.org/abs/2004.12919, without its robustification. Chance plays no part.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mdpo_rddl.simulator.simulator import Simulator, State

# of a ground fluent's spread, how wide a cell is: with a half MarsRover 1 took longer
_CELL = 1.0
# plans that are given at a time
_PAID = 16
_MOST_BYTES = 2**28

Act = Callable[[np.ndarray, State], tuple[Mapping[str, np.ndarray], np.ndarray]]
"""Of raw actions [D, P] in states [*shape, P] what is played, per action fluent [*shape, P], and
its raw actions [D, P]."""
Draw = Callable[[int, np.random.Generator], np.ndarray]
"""So many random plans [H, D, P]."""


class _Way(NamedTuple):
    """How a cell is reached: the first steps of a plan [T, D], after another cell's way."""

    before: int
    plan: np.ndarray


class Archive:
    """Cells and the ways there; it grows, and nothing of it is ever changed."""

    def __init__(
        self,
        simulator: Simulator,
        width: int,
        act: Act,
        draw: Draw,
        states: Sequence[Mapping[str, np.ndarray]],
    ) -> None:
        """Knows where episodes begin.

        Args:
          simulator: of the problem.
          width: raw actions D of a step.
          act: what plans play.
          draw: random plans, with which episodes go on.
          states: visited by some plans [*shape, P], whose spread says how wide a cell is.
        """
        self._simulator, self._act, self._draw = simulator, act, draw
        self._horizon = simulator.problem.horizon
        self._widths = {
            name: _width([each[name] for each in states])
            for name, value in states[0].items()
            if value.dtype.kind == "f"
        }
        self._cells: dict[int, int] = {}
        self._ways = [_Way(-1, np.zeros((0, width), np.float32))]
        state = simulator.initial(1)
        self._size, self._bytes = sum(value.nbytes for value in state.values()), 0
        self._states = {name: _Rows(value) for name, value in state.items()}
        self._steps, self._totals, self._taken = (_Rows(np.zeros(1)) for _ in range(3))

    def __len__(self) -> int:
        return len(self._ways)

    def explore(self, count: int, random: np.random.Generator) -> np.ndarray:
        """Goes on from cells, and gives the plans [H, D, P] that were paid most on the way."""
        simulator, horizon, size = self._simulator, self._horizon, len(self)
        taken = self._taken.values[:size]
        is_open = self._steps.values[:size] < horizon
        weights = is_open / np.sqrt(1.0 + taken)
        origin = random.choice(size, count, p=weights / weights.sum())
        np.add.at(taken, origin, 1.0)
        state = {name: rows.of(origin) for name, rows in self._states.items()}
        steps, totals = self._steps.values[origin].astype(int), self._totals.values[origin].copy()
        plans = self._draw(count, random)
        is_over = simulator.ended(state)
        best, reached = totals.copy(), np.zeros(count, int)
        discount = simulator.problem.model.discount
        for step in range(len(plans)):
            is_over = is_over | (steps + step >= horizon)
            if is_over.all():
                break
            actions, plans[step] = self._act(plans[step], state)
            after = simulator.step(state, actions, random)
            is_played = ~is_over & ~after.errors
            totals = totals + np.where(is_played, after.rewards * discount ** (steps + step), 0.0)
            state = {n: np.where(is_played, v, state[n]) for n, v in after.state.items()}
            is_better = is_played & (totals > best)
            best, reached = np.maximum(best, totals), np.where(is_better, step + 1, reached)
            is_over = ~is_played | after.terminated | after.broken
            if not (step + 1) & step:  # after 1, 2, 4, 8 .. steps
                self._add(state, np.flatnonzero(~is_over), origin, plans[: step + 1], totals)
        paid = np.argsort(self._totals.values[origin] - best, kind="stable")[:_PAID]
        return np.stack([self._plan(origin[k], plans[: reached[k], :, k]) for k in paid], axis=-1)

    def _plan(self, cell: int, after: np.ndarray) -> np.ndarray:
        """The plan [H, D] that goes to a cell, and on; then the no-op."""
        parts, place = [after], int(cell)
        while place >= 0:
            way = self._ways[place]
            parts.append(way.plan)
            place = way.before
        steps = np.concatenate(parts[::-1])[: self._horizon]
        return np.pad(steps, [(0, self._horizon - len(steps)), (0, 0)])

    def _add(
        self,
        state: State,
        places: np.ndarray,
        origin: np.ndarray,
        plans: np.ndarray,
        totals: np.ndarray,
    ) -> None:
        """Keeps states whose cells are new, or reached in fewer steps.

        Args:
          state: of P episodes [*shape, P].
          places: of those that go on.
          origin: the cells from which they came [P].
          plans: what they did since then [T, D, P].
          totals: discounted rewards so far [P].
        """
        if not len(places):
            return
        keys = _keys({n: v[..., places] for n, v in state.items()}, self._widths)
        keys, first = np.unique(keys, return_index=True)
        places = places[first]
        now = self._steps.values[origin[places]].astype(int) + len(plans)
        known = np.array([self._cells.get(key, -1) for key in keys.tolist()])
        is_new = (known < 0) | (self._steps.values[known] > now)
        size = self._size + plans[..., 0].nbytes
        is_new[max(0, (_MOST_BYTES - self._bytes) // size) :] = False
        self._bytes += size * int(is_new.sum())
        places, now, known = places[is_new], now[is_new], known[is_new]
        self._cells.update(zip(keys[is_new].tolist(), itertools.count(len(self)), strict=False))
        for place in places.tolist():
            self._ways.append(_Way(int(origin[place]), plans[:, :, place].copy()))
        for name, rows in self._states.items():
            rows.extend(state[name][..., places])
        taken = np.where(known < 0, 0.0, self._taken.values[known])
        # nobody goes on from a way that is longer than another one
        self._taken.values[known[known >= 0]] = np.inf
        for rows, values in ((self._steps, now), (self._totals, totals[places])):
            rows.extend(values)
        self._taken.extend(taken)


class _Rows:
    """An array that grows along its first axis."""

    def __init__(self, first: np.ndarray) -> None:
        """Takes the first row, along the last axis [*shape, 1]."""
        self.values, self._used = np.moveaxis(first, -1, 0).copy(), 1

    def extend(self, rows: np.ndarray) -> None:
        """Adds some, along the last axis [*shape, N]."""
        used, count = self._used, rows.shape[-1]
        while used + count > len(self.values):
            self.values = np.concatenate([self.values, np.zeros_like(self.values)])
        self.values[used : used + count] = np.moveaxis(rows, -1, 0)
        self._used += count

    def of(self, places: np.ndarray) -> np.ndarray:
        """Some rows [*shape, P]."""
        return np.moveaxis(self.values[places], 0, -1)


def _width(values: Sequence[np.ndarray]) -> np.ndarray:
    """How wide a cell is in each ground fluent [K, 1], by values [*shape, P]."""
    rows = np.concatenate([each.reshape(-1, each.shape[-1]) for each in values], axis=1)
    return np.maximum(_CELL * rows.std(axis=1, keepdims=True), 1e-9)


def _keys(state: Mapping[str, np.ndarray], widths: Mapping[str, np.ndarray]) -> np.ndarray:
    """A number for the cell of each state [P]; two cells share one once in 2^60 cases."""
    random, keys = np.random.default_rng(0), np.uint64(0)
    with np.errstate(all="ignore"):
        for name, value in state.items():
            cells = np.floor(value.reshape(-1, value.shape[-1]) / widths.get(name, 1.0))
            whole = np.nan_to_num(cells).astype(np.int64).astype(np.uint64)
            factors = random.integers(2**63, size=(len(whole), 1)).astype(np.uint64) | np.uint64(1)
            keys = keys + (whole * factors).sum(axis=0)
    return np.asarray(keys)
