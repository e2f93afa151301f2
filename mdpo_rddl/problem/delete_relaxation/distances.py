"""Costs of many states side by side, and the actions on the cheapest way to a reward."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.problem.delete_relaxation.circuit import Assignment, Part
from mdpo_rddl.problem.delete_relaxation.layers import Layered, layered
from mdpo_rddl.problem.delete_relaxation.relaxed import Relaxed

FAR = 1e6
"""A cost that stands for infinity."""


@dataclass(frozen=True)
class Prices:
    """What counts as a cost.

    Attributes:
      decay: of a reward's worth, for each step: a step costs -ln of it.
      tries: whether an event can be tried until it happens, of probability p 1/p - 1 more times;
        else it costs -ln p.

    Raises:
      ValueError: if the decay is not between 0 and 1.
    """

    decay: float = 0.9
    tries: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.decay < 1.0:
            raise ValueError(f"decay: {self.decay!r} is not between 0 and 1")

    @property
    def step(self) -> float:
        """What a step costs."""
        return -math.log(self.decay)

    def of_chance(self, costs: np.ndarray) -> np.ndarray:
        """What events cost, given the logarithms of their probabilities, negated."""
        with np.errstate(over="ignore"):
            priced = self.step * np.expm1(costs) if self.tries else costs
        return np.minimum(priced, FAR)


# what a cost must fall by to be swept again
_LEAST_CHANGE = 1e-3
# costs that are taken to be the same
_TIE = 1e-4


class Distances:
    """Evaluates the circuit of a relaxation by layers, to a fixed point.

    Rows are constants, then literals, then sums and minima of two.

    Attributes:
      worths: of the goals [G].
      lasts: whether each goal may pay at one step after another [G].
      rows: number R of costs.
    """

    def __init__(self, relaxed: Relaxed, most_steps: int = 100) -> None:
        """Puts the circuit in layers.

        Args:
          relaxed: the relaxation.
          most_steps: what needs more of them is out of reach.
        """
        circuit, self._most_steps = relaxed.circuit, most_steps
        self.worths = np.array([goal.worth for goal in relaxed.goals])
        self.lasts = np.array([goal.lasts for goal in relaxed.goals], bool)
        constants = [n for n, part in enumerate(circuit.parts) if part is Part.CONSTANT]
        self._constants = np.array([circuit.constants[node] for node in constants])
        literals = list(relaxed.steps)
        self._first = len(constants)
        places = {node: row for row, node in enumerate(constants)}
        for row, literal in enumerate(literals, start=self._first):
            places[circuit.literals[literal]] = row
        self._variables = np.array([each.variable for each in literals], int)
        self._values = np.array([each.value for each in literals], int)
        self._layered = layered(circuit, places, self._first + len(literals))
        self.rows = self._layered.rows
        self._next = np.array([places[relaxed.steps[each]] for each in literals], int)
        self._goals = np.array([places[goal.cost] for goal in relaxed.goals], int)
        self._rows, self._goal_rows = self._next.tolist(), self._goals.tolist()

    def __call__(self, states: np.ndarray, prices: Prices) -> np.ndarray:
        """The cost of every row [R, N], as the relaxation has it.

        Args:
          states: values of all state variables [V, N].
          prices: what counts.
        """
        costs = np.zeros((self.rows, states.shape[1]), np.float32)
        costs[: self._first] = prices.of_chance(self._constants)[:, np.newaxis]
        literals = costs[self._first : self._first + len(self._variables)]
        literals[:] = np.where(states[self._variables] == self._values[:, np.newaxis], 0.0, FAR)
        self._evaluate(costs)
        for _ in range(self._most_steps):
            reached = np.minimum(prices.step + costs[self._next], FAR)
            if not np.any(reached < literals - _LEAST_CHANGE):
                break
            np.minimum(literals, reached, out=literals)
            self._evaluate(costs)
        return costs

    def _evaluate(self, costs: np.ndarray) -> None:
        """Fills in the sums and the minima of costs [R, N] whose literals are given."""
        for part, one, other, start, stop in self._layered.layers:
            joined = np.add if part is Part.TOTAL else np.minimum
            # faster than costs[one] for few columns
            first = costs.take(one, axis=0, mode="clip")
            joined(first, costs.take(other, axis=0, mode="clip"), out=costs[start:stop])

    def to_goals(self, costs: np.ndarray) -> np.ndarray:
        """The costs of the goals [G, N], `FAR` or more where one is out of reach."""
        return costs[self._goals]

    def ways(self, costs: np.ndarray, state: np.ndarray) -> "Ways":
        """The ways from a state to the goals.

        Args:
          costs: of the state [R].
          state: values of all state variables [V].
        """
        holds = state[self._variables] == self._values
        literals = [None if held else row for held, row in zip(holds, self._rows, strict=True)]
        return Ways(costs.tolist(), literals, self._first, self._layered, self._goal_rows)


@dataclass(frozen=True, eq=False)
class Ways:
    """The cheapest ways from one state.

    Attributes:
      costs: of all rows.
      literals: of each literal the row that makes it true; None if it holds.
      first: row of the first literal.
      layered: the circuit.
      goals: their rows.
    """

    costs: Sequence[float]
    literals: Sequence[int | None]
    first: int
    layered: Layered
    goals: Sequence[int]

    def helpful(
        self, goal: int, all_ways: bool, seen: set[int] | None = None
    ) -> Sequence[Assignment]:
        """The actions that are legal in the state and on the cheapest way to a goal.

        They are the helpful actions of FF (Hoffmann and Nebel, "The FF planning system", 2001).

        Args:
          goal: the goal's number.
          all_ways: whether those of all ways count that cost the same.
          seen: rows that were looked at for other goals, whose actions are left out; it grows.
        """
        costs, pairs = self.costs, self.layered.pairs
        if costs[self.goals[goal]] >= FAR:
            return []
        found, waiting = [], [self.goals[goal]]
        seen = set() if seen is None else seen
        while waiting:
            row = waiting.pop()
            if row in seen or row < self.first:
                continue
            seen.add(row)
            pair = pairs.get(row)
            if pair is None:
                if (made_by := self.literals[row - self.first]) is not None:
                    waiting.append(made_by)
            elif pair.part is Part.LEAST:
                one, other = costs[pair.one], costs[pair.other]
                if one <= other + (_TIE if all_ways else 0.0):
                    waiting.append(pair.one)
                if other < one or (all_ways and other <= one + _TIE):
                    waiting.append(pair.other)
            else:
                if pair.part is Part.PLAYED and costs[pair.one] <= _TIE:
                    found.append(self.layered.assignments[row])
                waiting += [pair.one, pair.other]
        return found
