"""The exact model of a problem, for many replicas at once.

    simulator = Simulator(problem)
    state = simulator.initial(1024)
    step = simulator.step(state, {"fan-in": actions}, numpy.random.default_rng(0))

Replicas are the last axis of all arrays: a fluent of three zones in 1,024 replicas is [3, 1024].
The semantics are those of pyRDDLGym's `RDDLSimulator` and `RDDLEnv`; what would be an exception
there is a mask here, so that a replica's error is its own.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pyRDDLGym.core.compiler.initializer import RDDLValueInitializer
from pyRDDLGym.core.compiler.levels import RDDLLevelAnalysis

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.load import Problem, functions_by_name
from mdpo_rddl.simulator.compiler import DTYPES, Closure, Compiler, Frame, Node, UnsupportedError
from mdpo_rddl.simulator.scopes import Scope

# A block of fewer replicas spends its time in the interpreter. More are simulated at once where an
# array of theirs has no more bytes than the second number, fewer where it had more than the third.
_BLOCK, _CACHED_BYTES, _BLOCK_BYTES = 1024, 2**18, 2**23
# glibc maps an array above a threshold anew each time, page by page, and raises the threshold to
# the size of the array that was freed last.
_LARGE_ARRAY = 2**24

State = Mapping[str, np.ndarray]
"""Per fluent that is no action, its value [*shape, B]. States share arrays: write into none."""


class Step(NamedTuple):
    """What a step of B replicas comes to.

    Attributes:
      state: after it.
      rewards: [B], those of replicas with an error are 0.
      terminated: [B], whether a termination condition holds.
      broken: [B], whether a state invariant is violated, which ends the episode.
      errors: [B], whether pyRDDLGym's environment would have raised an error.
    """

    state: State
    rewards: np.ndarray
    terminated: np.ndarray
    broken: np.ndarray
    errors: np.ndarray


class Simulator:
    """A problem's exact model on numpy.

    Attributes:
      problem: the problem.
      shapes: of each fluent [*shape].
      actions: names of the action fluents.
      observed: names of what a policy sees: observation fluents, or state fluents.
      noop: per action fluent its default [*shape].
      values: per fluent and non-fluent its value before the first step [*shape].
      block: so many replicas are simulated at once, the others after them.
      draws_only_bools: whether all that a step draws is bools of the next state whose chances
        `step` can tell.
    """

    def __init__(self, problem: Problem) -> None:
        """Compiles the model's expressions to closures.

        Args:
          problem: a loaded problem, with the Python functions that its domain calls.

        Raises:
          InputError: for an expression that the simulator cannot evaluate.
        """
        model = self._model = problem.model
        self.problem = problem
        values = RDDLValueInitializer(model).initialize()
        kinds = model.variable_types
        arrays = {name: np.asarray(value) for name, value in values.items()}
        self.shapes = {
            name: tuple(model.object_counts(model.variable_params[name]))
            for name in model.variable_params
        }
        self.values = {n: np.broadcast_to(a, self.shapes[n]) for n, a in arrays.items()}
        self._rows = {name: math.prod(shape) for name, shape in self.shapes.items()}
        self._initial = {
            name: np.broadcast_to(array, self.shapes[name]).reshape(-1, 1)
            for name, array in arrays.items()
            if kinds[name] != "non-fluent"
        }
        constants = {
            name: np.broadcast_to(array, self.shapes[name]).reshape(-1)
            for name, array in arrays.items()
            if kinds[name] == "non-fluent"
        }
        self.actions = list(model.action_fluents)
        self.noop = {name: self._initial[name].reshape(self.shapes[name]) for name in self.actions}
        self._next = dict(model.next_state)
        self.observed = list(model.observ_fluents or model.state_fluents)
        primed = set(self._next.values())
        self._kept = {
            name: (*self.shapes[name], -1)
            for name in self._initial
            if name not in primed and name not in self.actions
        }
        self._constants, self._functions = constants, functions_by_name(problem)
        try:
            self._compile(constants, self._functions)
        except UnsupportedError as error:
            raise InputError(f"{problem.domain_path}: {error}") from error

    def _compile(
        self, constants: Mapping[str, np.ndarray], functions: Mapping[str, Callable[..., Any]]
    ) -> None:
        model = self._model
        compiler = Compiler(model, constants, self.shapes, functions)
        unprimed = {*model.derived_fluents, *model.interm_fluents}
        nodes: list[tuple[str, Node]] = []
        levels = RDDLLevelAnalysis(model, allow_synchronous_state=True).compute_levels()
        for name in (name for level in levels.values() for name in level):
            parameters, expression = model.cpfs[name]
            sizes = [(p, model.object_counts([kind])[0]) for p, kind in parameters]
            node = compiler.lower(expression, Scope().extended(sizes))
            nodes.append((name, node))
            if name in unprimed:
                compiler.fix(name, node)
        chances = []
        for name, following in self._next.items():
            parameters, expression = model.cpfs[following]
            if model.variable_ranges[name] == "bool" and compiler.traits(expression).draws:
                sizes = [(p, model.object_counts([kind])[0]) for p, kind in parameters]
                chances.append((name, compiler.chance(expression, Scope().extended(sizes))))
        for name in model.observ_fluents:
            parameters, expression = model.cpfs[name]
            if model.variable_ranges[name] == "bool":
                sizes = [(p, model.object_counts([kind])[0]) for p, kind in parameters]
                chances.append((name, compiler.chance(expression, Scope().extended(sizes))))
        reward = compiler.lower(model.reward, Scope())
        self._cpfs = [
            (name, DTYPES[compiler.kind(name)], compiler.link(node)) for name, node in nodes
        ]
        self._reward = compiler.link(reward)
        self._chances = [(name, compiler.link(node)) for name, node in chances if node is not None]
        read = {self._next.get(name, name) for name, _ in self._chances}
        others = [expression for name, (_, expression) in model.cpfs.items() if name not in read]
        self.draws_only_bools = not any(
            compiler.traits(each).draws for each in (*others, model.reward)
        )
        # conditions are looked at before the first step, too, where no fluent is derived yet
        of_states = Compiler(model, constants, self.shapes, functions)
        masks = {
            which: [of_states.lower(e, Scope()) for e in expressions]
            for which, expressions in (
                ("terminations", model.terminations),
                ("invariants", model.invariants),
                ("preconditions", model.preconditions),
            )
        }
        self._masks = {which: list(map(of_states.link, each)) for which, each in masks.items()}
        self._slots = max(compiler.slots, of_states.slots)
        largest = max(compiler.largest, of_states.largest)
        cached, memory = _CACHED_BYTES // largest, _BLOCK_BYTES // largest
        self.block = max(cached, min(_BLOCK, memory), 1)
        np.empty(_LARGE_ARRAY, np.uint8)

    def initial(self, replicas: int) -> State:
        """The state in which episodes begin, for so many replicas."""
        return {
            name: np.broadcast_to(self._initial[name], (self._rows[name], replicas)).reshape(
                *self.shapes[name], replicas
            )
            for name in self._kept
        }

    def observation(self, state: State) -> dict[str, np.ndarray]:
        """What a policy sees in a state, per fluent [*shape, B]; before a step of a partially
        observed problem the fluents' defaults."""
        return {name: state[name] for name in self.observed}

    def step(
        self,
        state: State,
        actions: Mapping[str, Any],
        generator: Any,
        chances: dict[str, np.ndarray] | None = None,
    ) -> Step:
        """Simulates one step of all replicas.

        Args:
          state: of B replicas.
          actions: per action fluent [*shape, B], or what broadcasts to it; the no-op where one is
            missing.
          generator: numpy's, makes all draws.
          chances: is given how likely each bool is in the next state, and of what is observed of
            that, [*shape, B], of the fluents for which the model states it.
        """
        replicas = next(iter(state.values())).shape[-1]
        if replicas > self.block:
            return self._in_blocks(state, actions, generator, chances)
        frame = self._frame(state, actions, generator, replicas)
        values = frame.values
        with np.errstate(all="ignore"):
            for name, dtype, closure in self._cpfs:
                values[name] = self._assigned(closure(frame), name, dtype, replicas)
            rewards = self._reward(frame)[0]
            if chances is not None:
                for name, closure in self._chances:
                    full = np.broadcast_to(closure(frame), (self._rows[name], replicas))
                    chances[name] = full.reshape(self._kept[name])
            for name, following in self._next.items():
                values[name] = values[following]
            frame.forget()
            terminated = self._any(self._masks["terminations"], frame)
            broken = ~self._all(self._masks["invariants"], frame)
        # a number of its own for each replica
        rewards = rewards * np.ones(replicas)
        if frame.lost.any():
            rewards[frame.lost] = 0.0
        after = {name: values[name].reshape(shape) for name, shape in self._kept.items()}
        return Step(after, rewards, terminated, broken, frame.lost)

    def values_of(
        self, expressions: Sequence[tuple[Any, Sequence[tuple[str, int]]]]
    ) -> Callable[[State, Mapping[str, Any]], list[np.ndarray]]:
        """Expressions without draws, for each tuple of the objects of some variables.

        Args:
          expressions: of pyRDDLGym's model, each with its variables and their numbers of objects.

        Returns:
          A function of a state of B replicas, at most `block` of them, and of actions as `step`
          takes them: of each expression its values [*numbers of objects, B].

        Raises:
          InputError: for an expression that the simulator cannot evaluate.
        """
        compiler = Compiler(self._model, self._constants, self.shapes, self._functions)
        try:
            nodes = [compiler.lower(each, Scope().extended(names)) for each, names in expressions]
        except UnsupportedError as error:
            raise InputError(f"{self.problem.domain_path}: {error}") from error
        closures, slots = [compiler.link(node) for node in nodes], compiler.slots
        sizes = [tuple(size for _, size in names) for _, names in expressions]

        def values(state: State, actions: Mapping[str, Any]) -> list[np.ndarray]:
            replicas = next(iter(state.values())).shape[-1]
            frame = self._frame(state, actions, None, replicas)
            frame.memo = [None] * slots
            found = []
            with np.errstate(all="ignore"):
                for closure, shape in zip(closures, sizes, strict=True):
                    flat = np.broadcast_to(closure(frame), (math.prod(shape), replicas))
                    found.append(flat.reshape(*shape, replicas))
            return found

        return values

    def ended(self, state: State) -> np.ndarray:
        """[B], whether a termination condition holds in a state."""
        replicas = next(iter(state.values())).shape[-1]
        if replicas > self.block:
            return np.concatenate([self.ended(part) for part, _ in self._blocks(state, {})])
        frame = self._frame(state, {}, None, replicas)
        with np.errstate(all="ignore"):
            return self._any(self._masks["terminations"], frame)

    def legal(self, state: State, actions: Mapping[str, Any]) -> np.ndarray:
        """[B], whether actions keep all preconditions and max-nondef-actions in a state."""
        replicas = next(iter(state.values())).shape[-1]
        if replicas > self.block:
            return np.concatenate([self.legal(*part) for part in self._blocks(state, actions)])
        frame = self._frame(state, actions, None, replicas)
        with np.errstate(all="ignore"):
            legal = self._all(self._masks["preconditions"], frame) & ~frame.lost
        most = self._model.max_allowed_actions
        if most < sum(self._rows[name] for name in self.actions):
            changed = sum(
                (frame.values[name] != self._initial[name]).sum(axis=0) for name in self.actions
            )
            legal &= changed <= most
        return legal

    def _frame(
        self, state: State, actions: Mapping[str, Any], generator: Any, replicas: int
    ) -> Frame:
        rows, initial = self._rows, self._initial
        values = {
            name: np.asarray(array, initial[name].dtype).reshape(rows[name], replicas)
            for name, array in state.items()
        }
        for name in self.actions:
            # a copy: what is played may become a part of the state
            full = np.empty((*self.shapes[name], replicas), self.noop[name].dtype)
            full[...] = actions[name] if name in actions else self.noop[name][..., None]
            values[name] = full.reshape(rows[name], replicas)
        return Frame(values, generator, replicas, self._slots)

    def _assigned(self, value: np.ndarray, name: str, dtype: Any, replicas: int) -> np.ndarray:
        if value.dtype != dtype:
            value = value.astype(dtype)
        shape = (self._rows[name], replicas)
        return value if value.shape == shape else np.broadcast_to(value, shape)

    def _blocks(
        self, state: State, actions: Mapping[str, Any]
    ) -> Iterator[tuple[State, Mapping[str, Any]]]:
        replicas = next(iter(state.values())).shape[-1]
        full = {
            name: np.broadcast_to(value, (*self.shapes[name], replicas))
            for name, value in actions.items()
        }
        for first in range(0, replicas, self.block):
            which = slice(first, first + self.block)
            yield (
                {name: value[..., which] for name, value in state.items()},
                {name: value[..., which] for name, value in full.items()},
            )

    def _in_blocks(
        self,
        state: State,
        actions: Mapping[str, Any],
        generator: Any,
        chances: dict[str, np.ndarray] | None,
    ) -> Step:
        parts, known = [], []
        for part in self._blocks(state, actions):
            known.append(None if chances is None else dict[str, np.ndarray]())
            parts.append(self.step(*part, generator, known[-1]))

        def joined(trees: Sequence[Any]) -> dict[str, np.ndarray]:
            return {n: np.concatenate([each[n] for each in trees], axis=-1) for n in trees[0]}

        if chances is not None:
            chances.update(joined(known))
        rest = (np.concatenate(each) for each in list(zip(*parts, strict=True))[1:])
        return Step(joined([each.state for each in parts]), *rest)

    @staticmethod
    def _any(closures: list[Closure], frame: Frame) -> np.ndarray:
        result = np.zeros(frame.replicas, bool)
        for closure in closures:
            result |= closure(frame)[0] != 0
        return result

    @staticmethod
    def _all(closures: list[Closure], frame: Frame) -> np.ndarray:
        result = np.ones(frame.replicas, bool)
        for closure in closures:
            result &= closure(frame)[0] != 0
        return result
