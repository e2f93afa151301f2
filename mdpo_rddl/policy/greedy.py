"""The greedy policy of a value, on numpy: one step of the exact model says what an action leads to.

It leaves the no-op with each component of the action whose change alone gains, to the value that
gains most, the best ones within the limits. The gain of a change d is estimated from a state s by
one step of the model, with random numbers that are the same for all changes,

    g_d = r(s, d) + gamma v(s'_d) - r(s, no-op) - gamma v(s'_no-op),

v being a value of the next state (`Values`), and what is usual at the step, and 0 after the end of
an episode. Where the model states how likely a bool is in s', v reads that, which is exact for what
is linear in it and a mean field for the rest. Joint gains are taken for the sums of single ones;
where some action is no bool, and `max-nondef-actions` allows all to change, the components are
decided in turn instead, each beside what was decided before it.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.plans.feedback_actions import in_order
from mdpo_rddl.planner.plans.limits import choose_within_limits
from mdpo_rddl.policy.legal import LegalActions
from mdpo_rddl.problem.boxes import action_boxes
from mdpo_rddl.problem.limits import concurrency_limits, group_limits
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.simulator.common import CommonNumbers
from mdpo_rddl.simulator.simulator import Simulator, State

Arrays = Mapping[str, np.ndarray]
Params = dict[str, np.ndarray]

METHOD = "GreedyPlan"
"""The name of these policies in a configuration."""

# of one component
_MOST_VALUES = 64
# samples of a step of which not all that is drawn is read as chances, and steps that a decision
# tries in all
_SAMPLES, _TRIED = 8, 2048
_TINY = 1e-12
# of the value: larger ones have products of thousands of inputs, which are left out
_MOST_INPUTS = 2048
_LARGEST_INPUT = 5.0
# how many inputs are on at a time, about
_FEW = 4.0


class Changes(NamedTuple):
    """D changes of the no-op, each of one component, those of a component side by side.

    Attributes:
      names: action fluents.
      noop: of all components side by side [C].
      places: the component of each change [D].
      values: what it becomes [D].
      table: the changes of each component [C, K], D where it has fewer.
      numbers: the action fluents that are no bools.
    """

    names: Sequence[str]
    noop: np.ndarray
    places: np.ndarray
    values: np.ndarray
    table: np.ndarray
    numbers: frozenset[str]

    @property
    def size(self) -> int:
        """How many, D."""
        return len(self.places)

    @classmethod
    def of(cls, simulator: Simulator) -> "Changes | None":
        """Those of a problem; None if an action is real, or has many values or no bounds."""
        model = simulator.problem.model
        boxes, rows, places = action_boxes(model), list[list[float]](), list[int]()
        for name in simulator.actions:
            kind, noop = model.variable_ranges[name], np.ravel(simulator.noop[name])
            if kind == "real":
                return None
            lower, upper = (np.ravel(end) for end in boxes[name])
            if kind == "bool":
                lower, upper = np.zeros(len(noop)), np.ones(len(noop))
            elif kind in model.type_to_objects:
                lower, upper = np.zeros(len(noop)), np.full(len(noop), -1.0)
                upper += len(model.type_to_objects[kind])
            if not np.all(upper - lower < _MOST_VALUES):
                return None  # infinite ones, too
            for one, low, high in zip(noop, lower, upper, strict=True):
                values = np.arange(math.ceil(low), math.floor(high) + 1.0)
                rows.append([float(value) for value in values if value != one])
        if not any(rows):
            return None
        places = [place for place, row in enumerate(rows) for _ in row]
        most, table, start = max(map(len, rows)), [], 0
        for row in rows:
            own = [*range(start, start + len(row))]
            table.append(own + [len(places)] * (most - len(row)))
            start += len(row)
        idle = [np.ravel(simulator.noop[name]).astype(float) for name in simulator.actions]
        numbers = {n for n in simulator.actions if model.variable_ranges[n] != "bool"}
        return cls(
            simulator.actions,
            np.concatenate(idle),
            np.array(places),
            np.array([value for row in rows for value in row]),
            np.array(table),
            frozenset(numbers),
        )


class Values:
    """The value of a state x with a share l of the steps left, a hidden layer beside a line:

        v(x, l) = x . (w + l w') + relu(x H + b + l b') . (o + l o').

    x are the ground state fluents, for those whose values are objects whether it is each of these,
    and the products of two of them that are about the same objects, f(a) g(a, b): where something
    is and what is there as well. What is left of the horizon matters for those that end it, as l
    times the others does not tell.

    Attributes:
      size: number of inputs x.
    """

    def __init__(self, simulator: Simulator, arguments: Mapping[str, Any]) -> None:
        """Finds the inputs.

        Args:
          simulator: of the problem.
          arguments: `units` of the hidden layer, and `state_scales`, per fluent that is no bool its
            centre and scale.

        Raises:
          ValueError: if there is no such number of units.
        """
        model = simulator.problem.model
        self._horizon = simulator.problem.horizon
        self._units = arguments.get("units", 128)
        if not (isinstance(self._units, int) and 1 <= self._units <= 1024):
            raise ValueError(f"units: must be a whole number from 1 to 1024, got {self._units!r}")
        self._shapes = {name: simulator.shapes[name] for name in model.state_fluents}
        given = arguments.get("state_scales") or {}
        numbers = [n for n in self._shapes if model.variable_ranges[n] != "bool"]
        self._scales = {name: given[name] for name in numbers if name in given}
        self._objects = {
            name: len(model.type_to_objects[model.variable_ranges[name]])
            for name in numbers
            if model.variable_ranges[name] in model.type_to_objects
        }
        sizes = {name: math.prod(shape) for name, shape in self._shapes.items()}
        singles = sum(sizes.values())
        singles += sum(sizes[name] * count for name, count in self._objects.items())
        self._products = _products(model, self._shapes)
        pairs = sum(sizes[wide] for _, wide, _ in self._products)
        if singles + pairs > _MOST_INPUTS:
            self._products, pairs = [], 0
        self.size = singles + pairs

    def initial(self, random: np.random.Generator) -> Params:
        """Weights with which every value is zero."""
        scale = min(1.0, math.sqrt(_FEW / max(1, self.size)))
        shapes: list[tuple[int, ...]] = [(self.size, self._units), (self._units,), (self._units,)]
        drawn = [random.standard_normal(shape).astype(np.float32) for shape in shapes]
        none, hidden = (np.zeros(count, np.float32) for count in (self.size, self._units))
        return {
            "direct": none,
            "direct_left": none,
            "hidden": np.float32(scale) * drawn[0],
            "bias": drawn[1],
            "bias_left": drawn[2],
            "output": hidden,
            "output_left": hidden,
            "levels": np.zeros(self._horizon, np.float32),
        }

    def inputs(self, state: Arrays) -> np.ndarray:
        """What the net reads [size, B], of a state or of its bools' chances [*shape, B]."""
        known = {name: self._scaled(name, state[name]) for name in self._shapes}
        parts = [np.reshape(each, (-1, each.shape[-1])) for each in known.values()]
        for name, count in self._objects.items():
            of_each = state[name][..., np.newaxis, :] == np.arange(count)[:, np.newaxis]
            parts.append(np.reshape(of_each, (-1, of_each.shape[-1])))
        for narrow, wide, sizes in self._products:
            product = np.reshape(known[narrow], (*sizes, -1)) * known[wide]
            parts.append(np.reshape(product, (-1, product.shape[-1])))
        return np.concatenate(parts, dtype=np.float32)

    def value(self, params: Params, inputs: np.ndarray, step: Any) -> np.ndarray:
        """The return that is expected from a step on [B], beyond what is usual; 0 at the end.

        Args:
          params: see `initial`.
          inputs: [size, B].
          step: of each [B], or of all.
        """
        left = np.maximum(0.0, 1.0 - np.asarray(step, np.float32) / self._horizon)
        left = np.asarray(left, np.float32)
        hidden = params["hidden"].T @ inputs
        hidden += params["bias"][:, np.newaxis] + params["bias_left"][:, np.newaxis] * left
        np.maximum(hidden, 0.0, out=hidden)
        value = (params["direct"] @ inputs) + left * (params["direct_left"] @ inputs)
        value += params["output"] @ hidden + left * (params["output_left"] @ hidden)
        return np.where(left > 0.0, value, 0.0)

    def level(self, params: Params, step: int) -> float:
        """What is usual from a step on; 0 at the end of the horizon."""
        return float(params["levels"][step]) if step < self._horizon else 0.0

    def _scaled(self, name: str, value: np.ndarray) -> np.ndarray:
        center, scale = self._scales.get(name, (0.0, 1.0))
        number = (np.asarray(value, np.float32) - np.float32(center)) / np.float32(scale)
        return np.clip(number, -_LARGEST_INPUT, _LARGEST_INPUT)


class GreedyFormula:
    """The greedy policies of a problem, as functions of their values' parameters.

    Attributes:
      changes: of the no-op.
      values: of states.
      samples: of a step of the model.
    """

    def __init__(
        self, problem: Problem, config: PlannerConfig, simulator: Simulator | None = None
    ) -> None:
        """Finds the changes and the inputs.

        Args:
          problem: that is played.
          config: with a `GreedyPlan`.
          simulator: of the problem; made here if None.

        Raises:
          InputError: if an action has many values or the state is not observed, or the
            configuration does not fit.
        """
        simulator = self._simulator = Simulator(problem) if simulator is None else simulator
        model, arguments = problem.model, config.policy_arguments
        changes = None if model.observ_fluents else Changes.of(simulator)
        if changes is None:
            raise InputError(
                f"{config.source}: GreedyPlan needs actions of few values each and an observed "
                "state"
            )
        self.changes = changes
        try:
            self.values = Values(simulator, arguments)
        except (TypeError, ValueError) as error:
            raise InputError(f"{config.source}: [Planner] method_kwargs: {error}") from error
        self._states, self._discount = list(model.state_fluents), float(model.discount)
        components = len(changes.noop)
        shapes = {name: simulator.shapes[name] for name in simulator.actions}
        self._limits, self._at_most = group_limits(model)[0], None
        if changes.numbers:
            few = model.max_allowed_actions < components
            self._at_most = max(1, int(model.max_allowed_actions)) if few else None
        elif not np.any(changes.noop):
            self._limits = [*self._limits, *concurrency_limits(model, shapes)]
        self.is_in_turn = bool(changes.numbers) and components > 1 and self._at_most is None
        self._legal = LegalActions(simulator, self._limits)
        usual = min(_SAMPLES, max(1, _TRIED // (1 + changes.size)))
        self.samples = arguments.get("samples") or (1 if simulator.draws_only_bools else usual)

    def replicas(self, params: Params, seed: int) -> "GreedyReplicas":
        """What decides for B episodes at once; draws from a seed."""
        return GreedyReplicas(self, params, seed)

    def gains(self, params: Params, state: State, step: int, seed: Any) -> np.ndarray:
        """What each change gains over the no-op [D, B], alone or beside what is decided before it.

        Args:
          params: of the value.
          state: per fluent [*shape, B].
          step: of the rollout, from 0.
          seed: of the samples.
        """
        count = next(iter(state.values())).shape[-1]
        decided = np.repeat(self.changes.noop[:, np.newaxis], count, axis=1)
        if self.is_in_turn:
            return self._gains_in_turn(params, state, step, (seed, decided))
        every = np.arange(self.changes.size)
        return self._gains(params, state, step, (seed, decided, every))

    def choose(self, gains: np.ndarray, state: State) -> dict[str, np.ndarray]:
        """A legal action of the changes that gain, per action fluent [*shape, B].

        Args:
          gains: of the changes [D, B], or what is in their order and has their signs.
          state: per fluent [*shape, B].
        """
        changes = self.changes
        most, best = self._best(gains)
        if self._at_most is not None:
            rank = np.argsort(np.argsort(-most, axis=0, kind="stable"), axis=0, kind="stable")
            most = np.where(rank < self._at_most, most, -1.0)
        noop = changes.noop[:, np.newaxis]
        flat = np.where(most > 0.0, np.append(changes.values, 0.0)[best], noop)
        action = self._tree(flat)
        leaving = in_order(most / (np.max(np.abs(gains), axis=0) + _TINY))
        true = self._tree(np.where(noop > 0.5, 1.0 - leaving, leaving), float)
        true = {name: value for name, value in true.items() if name not in changes.numbers}
        grouped = {name for limit in self._limits for name in limit.groups}
        if grouped:
            action |= choose_within_limits({name: true[name] for name in grouped}, self._limits)
        return self._legal(action, lambda: true, state) if self._legal.is_needed else action

    def _best(self, gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What each component's best change gains [C, B], and which it is [C, B]."""
        table = self.changes.table
        if table.shape[1] == 1 and len(table) == len(gains):
            return gains, np.broadcast_to(np.arange(len(gains))[:, np.newaxis], gains.shape)
        last = np.full((1, gains.shape[1]), -np.inf)
        each = np.concatenate([gains, last])[table]
        best = np.argmax(each, axis=1)
        most = np.take_along_axis(each, best[:, np.newaxis], axis=1)[:, 0]
        return most, np.take_along_axis(table, best, axis=1)

    def _gains_in_turn(
        self, params: Params, state: State, step: int, given: tuple[Any, np.ndarray]
    ) -> np.ndarray:
        """Gains of which each component's are over the best of what comes before it."""
        seed, decided = given
        gains = np.full((self.changes.size, decided.shape[1]), -np.inf)
        everyone = np.arange(decided.shape[1])
        for component, row in enumerate(self.changes.table):
            own = row[row < self.changes.size]
            if not len(own):
                continue
            gains[own] = self._gains(params, state, step, (seed, decided, own))
            best = own[np.argmax(gains[own], axis=0)]
            is_better = gains[best, everyone] > 0.0
            decided = decided.copy()
            decided[component] = np.where(is_better, self.changes.values[best], decided[component])
        return gains

    def _gains(
        self, params: Params, state: State, step: int, given: tuple[Any, np.ndarray, np.ndarray]
    ) -> np.ndarray:
        """What each of some changes gains beside what is decided [d, B].

        Args:
          params: of the value.
          state: of B replicas.
          step: of the rollout.
          given: the seed, what is decided [C, B], and the changes [d].
        """
        seed, decided, which = given
        count, block = decided.shape[1], self._simulator.block
        # a change that a precondition forbids in a state is not tried there
        tried = self._allowed(state)[self.changes.places[which]]
        tried |= self.changes.values[which, np.newaxis] == 0.0
        rows, replicas = np.nonzero(tried)
        numbers = np.concatenate([np.full(count, -1), which[rows]])
        replicas = np.concatenate([np.arange(count), replicas])
        totals = np.zeros(len(numbers))
        for sample in range(self.samples):
            for first in range(0, len(numbers), block):
                some = slice(first, first + block)
                # the same numbers for a replica and all its changes, whatever is simulated at once
                random = np.random.default_rng([*np.atleast_1d(seed), sample])
                own = decided, numbers[some], replicas[some], random
                totals[some] += self._stepped(params, state, step, own)
        gains = np.full(tried.shape, -np.inf)
        gains[rows, replicas[count:]] = (totals[count:] - totals[replicas[count:]]) / self.samples
        return np.nan_to_num(gains, nan=0.0, neginf=-np.inf)

    def _allowed(self, state: State) -> np.ndarray:
        """Whether preconditions on single bools let a component leave its no-op [C, B]."""
        count = next(iter(state.values())).shape[-1]
        allowed = self._legal.allowed(state)
        parts = [
            np.broadcast_to(
                np.reshape(
                    allowed.get(name, np.ones(1, bool)), (-1, count if name in allowed else 1)
                ),
                (self._simulator.noop[name].size, count),
            )
            for name in self.changes.names
        ]
        return np.concatenate(parts)

    def _stepped(
        self, params: Params, state: State, step: int, given: tuple[Any, ...]
    ) -> np.ndarray:
        """What is expected of some replicas [b], each with a change, or none where it is -1."""
        decided, numbers, replicas, random = given
        actions = decided[:, replicas]
        changed = np.flatnonzero(numbers >= 0)
        chosen = numbers[changed]
        actions[self.changes.places[chosen], changed] = self.changes.values[chosen]
        whole = {name: value[..., replicas] for name, value in state.items()}
        chances: dict[str, np.ndarray] = {}
        common = CommonNumbers(random, replicas)
        after = self._simulator.step(whole, self._tree(actions), common, chances)
        following = {name: after.state[name] for name in self._states} | chances
        worth = self.values.value(params, self.values.inputs(following), step + 1)
        ended = after.terminated | after.broken | after.errors
        # what is usual is the same for all that goes on
        level = self.values.level(params, step + 1)
        total = after.rewards + self._discount * np.where(ended, -level, worth)
        return np.where(after.errors, -np.inf, total)

    def _tree(self, flat: np.ndarray, kind: Any = None) -> dict[str, np.ndarray]:
        """Components [C, B] per action fluent [*shape, B]."""
        tree, start = {}, 0
        for name in self.changes.names:
            noop = self._simulator.noop[name]
            part = flat[start : start + noop.size]
            tree[name] = part.reshape(*noop.shape, -1).astype(kind or noop.dtype)
            start += noop.size
        return tree


class GreedyReplicas:
    """A greedy policy for B episodes at once; the same state at a step is the same decision."""

    def __init__(self, formula: GreedyFormula, params: Params, seed: int) -> None:
        """Plays nothing yet."""
        self._formula, self._params, self._seed = formula, params, seed

    def __call__(self, step: int, observation: Arrays) -> dict[str, np.ndarray]:
        """Per action fluent [*shape, B]."""
        with np.errstate(all="ignore"):
            gains = self._formula.gains(self._params, observation, step, [self._seed, step])
            return self._formula.choose(gains, observation)

    def were_played(self, actions: Arrays) -> None:
        """It remembers nothing."""


def _products(
    model: Any, shapes: Mapping[str, tuple[int, ...]]
) -> list[tuple[str, str, tuple[int, ...]]]:
    """Pairs of fluents, the narrow one first, and the shape in which it meets the wide one."""
    found, names = [], list(shapes)
    for number, first in enumerate(names):
        for second in names[number + 1 :]:
            narrow, wide = sorted((first, second), key=lambda name: len(shapes[name]))
            axes = _places(model.variable_params[narrow], model.variable_params[wide])
            if axes is not None:
                size = shapes[wide]
                sizes = tuple(size[axis] if axis in axes else 1 for axis in range(len(size)))
                found.append((narrow, wide, sizes))
    return found


def _places(narrow: Sequence[str], wide: Sequence[str]) -> list[int] | None:
    """Where the types of one fluent are among another's, in order; None if they are not."""
    axes: list[int] = []
    for kind in narrow:
        after = axes[-1] + 1 if axes else 0
        place = next((axis for axis in range(after, len(wide)) if wide[axis] == kind), None)
        if place is None:
            return None
        axes.append(place)
    return axes
