"""Going where no plan has been: for problems in which a reward must first be found.

An archive keeps, for each cell of the state space that was ever visited, a plan that leads there
in few steps; new plans follow one of them and then try something. That is Go-Explore, Ecoffet
et al. (2021), https://arxiv.org/abs/2004.12919, without its robustification.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from mdpo_rddl.auto.search.mutations import Layout, random_values

# of a state's scale
_CELL = 0.5
_FARTHEST = 120
_MOST_BYTES, _MOST_CELLS = 2 * 10**8, 200_000
_PLACES = 0.3
_LONGEST_HOLD = 40.0
_HOLD, _BOOL = 0.7, 0.3


class Archive:
    """Cells of the state space and plans that lead there."""

    def __init__(self, layout: Layout, scales: Mapping[str, Sequence[float]], seed: int) -> None:
        """Knows no cell yet.

        Args:
          layout: of the plans.
          scales: per observed fluent its centre and scale; a cell is half a scale wide.
          seed: of the plans that it makes.
        """
        self._layout, self._scales = layout, scales
        self._random = np.random.default_rng([seed, 1])
        self._cells: dict[bytes, int] = {}
        self._prefixes: list[np.ndarray] = []
        # of each cell: the steps of its plan that lead there, and plans that began there
        self._steps, self._taken = np.zeros((2, _MOST_CELLS), int)
        self._horizon = 0
        # of each plan that is kept, by its id: cells that it leads to
        self._uses: Counter[int] = Counter()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._prefixes)

    def add(self, plans: np.ndarray, states: Mapping[str, np.ndarray]) -> None:
        """Takes note of where plans have led.

        Args:
          plans: raw plans [P, H, D].
          states: per observed fluent what each plan saw after each step [P, H, *shape].
        """
        count, horizon = plans.shape[:2]
        self._horizon = horizon
        # in the order of the steps, so that a cell's first place is the earliest step
        cells = [
            np.swapaxes(self._cell(name, values), 0, 1).reshape(horizon * count, -1)
            for name, values in states.items()
        ]
        joined = np.ascontiguousarray(np.concatenate(cells, axis=1))
        whole = joined.view(np.dtype((np.void, joined.shape[1]))).ravel()
        first = self._first_places(joined)
        names = whole[first].tolist()
        known = np.array([self._cells.get(name, -1) for name in names])
        steps, rows = first // count + 1, first % count
        is_found = (known < 0) | (self._steps[known] > steps)
        found: dict[int, list[tuple[int, bytes]]] = {}
        for number in np.flatnonzero(is_found).tolist():
            found.setdefault(int(rows[number]), []).append((int(steps[number]), names[number]))
        for row, ways in found.items():
            prefix = plans[row, : max(steps for steps, _ in ways)]
            if self._bytes + prefix.nbytes <= _MOST_BYTES:
                self._keep(prefix.copy(), ways)

    def _keep(self, prefix: np.ndarray, ways: Sequence[tuple[int, bytes]]) -> None:
        """Keeps the first steps of a plan, and for each cell in how many of them it leads there."""
        self._bytes += prefix.nbytes
        self._uses[id(prefix)] += 1  # as long as it is looked at
        for steps, cell in ways:
            known = self._cells.get(cell)
            if known is not None:
                self._release(self._prefixes[known])
                self._prefixes[known] = prefix
            elif len(self) < _MOST_CELLS:
                known = self._cells[cell] = len(self)
                self._prefixes.append(prefix)
            else:
                continue
            self._steps[known] = steps
            self._uses[id(prefix)] += 1
        self._release(prefix)

    def _release(self, prefix: np.ndarray) -> None:
        self._uses[id(prefix)] -= 1
        if not self._uses[id(prefix)]:
            del self._uses[id(prefix)]
            self._bytes -= prefix.nbytes

    def plans(self, count: int) -> np.ndarray:
        """Plans that go to a cell, preferably one from which few began, and on [count, H, D]."""
        weights = 1.0 / np.sqrt(1.0 + self._taken[: len(self)])
        chosen = self._random.choice(len(self), size=count, p=weights / np.sum(weights))
        np.add.at(self._taken, chosen, 1)
        return self._gone_on(chosen)

    def _cell(self, name: str, values: np.ndarray) -> np.ndarray:
        center, scale = self._scales[name]
        cells = np.floor((np.asarray(values, float) - center) / (_CELL * scale))
        return np.clip(np.nan_to_num(cells), -_FARTHEST, _FARTHEST).astype(np.int8)

    def _first_places(self, cells: np.ndarray) -> np.ndarray:
        """The first place of each different cell in an array of them [N, L]."""
        # numbers are sorted several times as fast as bytes; two cells share one with a probability
        # of about 2^-60
        factors = np.random.default_rng(cells.shape[1]).integers(2**63, size=cells.shape[1]) | 1
        with np.errstate(over="ignore"):
            keys = np.sum(cells * factors, axis=1)
        return np.unique(keys, return_index=True)[1]

    def _gone_on(self, cells: np.ndarray) -> np.ndarray:
        """Plans that lead to cells, and then set some actions for a while each [C, H, D]."""
        random, is_bool, horizon = self._random, self._layout.is_bool, self._horizon
        plans = np.zeros((len(cells), horizon, len(is_bool)), self._prefixes[0].dtype)
        for plan, cell, step in zip(plans, cells, self._steps[cells], strict=True):
            plan[:step] = self._prefixes[cell][:step]
        counts = np.minimum(len(is_bool), random.geometric(_PLACES, size=len(cells)))
        order = np.argsort(random.random((len(cells), len(is_bool))), axis=1)
        rows = np.repeat(np.arange(len(cells)), counts)
        places = np.concatenate([row[:count] for row, count in zip(order, counts, strict=True)])
        held = self._held(is_bool[places])
        begins = self._steps[cells][rows]
        for row, place, begin, values in zip(
            rows.tolist(), places.tolist(), begins.tolist(), held, strict=True
        ):
            plans[row, begin:, place] = values[: horizon - begin]
        return plans

    def _held(self, is_bool: np.ndarray) -> np.ndarray:
        """Values of actions, each for a while [C, H]."""
        random, shape = self._random, (len(is_bool), self._horizon)
        bools, numbers = (
            random_values(kind, shape[0] * shape[1], random) for kind in (True, False)
        )
        values = np.where(is_bool[:, np.newaxis], bools.reshape(shape), numbers.reshape(shape))
        values *= random.random(shape) < np.where(is_bool, _BOOL, _HOLD)[:, np.newaxis]
        lengths = np.ceil(_LONGEST_HOLD ** random.random(shape)).astype(int)
        # at each step, how many of the values are over
        ends = np.zeros((shape[0], shape[1] + 1), int)
        each = np.arange(shape[0])[:, np.newaxis]
        ends[each, np.minimum(np.cumsum(lengths, axis=1), shape[1])] = 1
        return np.take_along_axis(values, np.cumsum(ends[:, :-1], axis=1), axis=1)
