"""Going where no plan has been: for problems in which a reward must first be found.

An archive keeps, for each cell of the state space that was ever visited, a plan that leads there
in few steps; new plans follow one of them and then try something. That is Go-Explore, Ecoffet
et al. (2021), https://arxiv.org/abs/2004.12919, without its robustification.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from mdpo_rddl.auto.search.mutations import Layout, random_values
from mdpo_rddl.auto.state import State, generator_place, set_generator

# of a state's scale
_CELL = 0.5
_FARTHEST = 120
_MOST_BYTES, _MOST_CELLS = 2 * 10**8, 200_000
# of the plans that another process goes on with
_MOST_STATE_BYTES = 2**25
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
        self._prefixes: list[tuple[np.ndarray, int]] = []
        self._taken: list[int] = []
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
        unique, first = np.unique(whole, return_index=True)
        found: dict[int, list[tuple[int, bytes]]] = {}
        for cell, place in zip(unique.tolist(), first.tolist(), strict=True):
            step, row = divmod(place, count)
            known = self._cells.get(cell)
            if known is None or self._prefixes[known][1] > step + 1:
                found.setdefault(row, []).append((step + 1, cell))
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
                self._release(self._prefixes[known][0])
                self._prefixes[known] = prefix, steps
            elif len(self) < _MOST_CELLS:
                self._cells[cell] = len(self)
                self._prefixes.append((prefix, steps))
                self._taken.append(0)
            else:
                continue
            self._uses[id(prefix)] += 1
        self._release(prefix)

    def _release(self, prefix: np.ndarray) -> None:
        self._uses[id(prefix)] -= 1
        if not self._uses[id(prefix)]:
            del self._uses[id(prefix)]
            self._bytes -= prefix.nbytes

    def plans(self, count: int) -> np.ndarray:
        """Plans that go to a cell, preferably one from which few began, and on [count, H, D]."""
        weights = 1.0 / np.sqrt(1.0 + np.array(self._taken))
        chosen = self._random.choice(len(self), size=count, p=weights / np.sum(weights))
        return np.stack([self._go_on(cell) for cell in chosen])

    def state(self) -> State:
        """The cells and their plans, the first ones if there are too many of them.

        The plans are [U, H, D], the cells' names [C, L] bytes.
        """
        numbers: dict[int, int] = {}
        plans: list[np.ndarray] = []
        shape = (self._horizon, len(self._layout.is_bool))
        kept: list[tuple[bytes, int, int, int]] = []
        used = 0
        for cell, place in self._cells.items():
            plan, step = self._prefixes[place]
            if id(plan) not in numbers:
                whole = np.zeros(shape, plan.dtype)
                used += whole.nbytes
                if used > _MOST_STATE_BYTES:
                    break
                whole[: len(plan)] = plan
                numbers[id(plan)] = len(plans)
                plans.append(whole)
            kept.append((cell, numbers[id(plan)], step, self._taken[place]))
        values = {"generator": generator_place(self._random)}
        if not kept:
            return State({}, values)
        names, of_plan, steps, taken = zip(*kept, strict=True)
        tensors = {
            "cells": np.frombuffer(b"".join(names), np.uint8).reshape(len(names), -1),
            "plans": np.stack(plans),
            "cell_plans": np.array(of_plan),
            "steps": np.array(steps),
            "taken": np.array(taken),
        }
        return State(tensors, values)

    def restore(self, state: State, horizon: int) -> None:
        """Knows what another archive of the same states and plans has known.

        Raises:
          LookupError, OverflowError, TypeError, ValueError: if the state does not fit; the
            archive is of no use then.
        """
        set_generator(self._random, state.values["generator"])
        if not state.tensors:
            return
        cells = state.array("cells", (None, None))
        plans = state.array("plans", (None, horizon, len(self._layout.is_bool)))
        count = len(cells)
        of_plan, steps, taken = (
            state.array(name, (count,)) for name in ("cell_plans", "steps", "taken")
        )
        for numbers, least, most in (
            (of_plan, 0, len(plans) - 1),
            (steps, 1, horizon),
            (taken, 0, np.inf),
        ):
            if numbers.dtype.kind != "i" or np.any((numbers < least) | (numbers > most)):
                raise ValueError("its cells lead nowhere")
        if cells.dtype != np.uint8 or count > _MOST_CELLS:
            raise ValueError(
                f"its cells are {count} of {cells.dtype}, not uint8 or over {_MOST_CELLS}"
            )
        names = [cell.tobytes() for cell in cells]
        if len(set(names)) != count:
            raise ValueError("its cells are not different ones")
        self._cells = dict(zip(names, range(count), strict=True))
        rows = [plan.copy() for plan in plans]
        pairs = zip(of_plan.tolist(), steps.tolist(), strict=True)
        self._prefixes = [(rows[number], step) for number, step in pairs]
        self._uses = Counter(id(prefix) for prefix, _ in self._prefixes)
        self._horizon, self._taken = horizon, taken.tolist()
        self._bytes = sum(rows[number].nbytes for number in np.unique(of_plan))

    def _cell(self, name: str, values: np.ndarray) -> np.ndarray:
        center, scale = self._scales[name]
        cells = np.floor((np.asarray(values, float) - center) / (_CELL * scale))
        return np.clip(np.nan_to_num(cells), -_FARTHEST, _FARTHEST).astype(np.int8)

    def _go_on(self, cell: int) -> np.ndarray:
        random, is_bool = self._random, self._layout.is_bool
        prefix, step = self._prefixes[cell]
        self._taken[cell] += 1
        plan = np.zeros((self._horizon, prefix.shape[1]), prefix.dtype)
        plan[:step] = prefix[:step]
        left, places = len(plan) - step, plan.shape[1]
        count = min(places, random.geometric(_PLACES))
        for place in random.choice(places, size=count, replace=False):
            values = random_values(is_bool[place], left, random)
            values *= random.random(left) < (_BOOL if is_bool[place] else _HOLD)
            lengths = np.ceil(_LONGEST_HOLD ** random.random(left)).astype(int)
            plan[step:, place] = np.repeat(values, lengths)[:left]
        return plan
