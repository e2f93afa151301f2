"""A whole episode as a linear program over its actions, the random numbers known."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.grounding import Ground
from mdpo_rddl.problem.hindsight.draws import Draws, MissingDrawError
from mdpo_rddl.problem.hindsight.one_step import OneStep
from mdpo_rddl.problem.hindsight.operators import applied, written
from mdpo_rddl.problem.hindsight.piecewise import Piecewise
from mdpo_rddl.problem.hindsight.program import Affine, NotLinearError, Program, Value
from mdpo_rddl.problem.legality import action_box

_KINDS = {"bool", "int", "real"}
_END = "an end of the episode that may depend on the actions"


@dataclass(frozen=True)
class Unrolled:
    """An episode's program.

    Attributes:
      program: its rows hold for every legal plan.
      objective: discounted return.
      actions: per step and ground action the value that a plan gives it.
    """

    program: Program
    objective: Value
    actions: tuple[Mapping[Ground, Affine], ...]

    def plan(self, env: RDDLEnv, values: np.ndarray) -> list[dict[str, np.ndarray]]:
        """The actions of each step, of the variables' values."""
        plan = []
        for step in self.actions:
            actions = {name: np.array(value) for name, value in env.sampler.noop_actions.items()}
            for (name, place), decided in step.items():
                value = sum(float(f * values[v]) for v, f in decided.terms.items())
                is_real = actions[name].dtype.kind == "f"
                actions[name][place] = value if is_real else round(value)
            plan.append(actions)
        return plan


def unroll(
    step: OneStep, env: RDDLEnv, draws: Draws, check: Callable[[], object] = lambda: None
) -> Unrolled:
    """Puts the steps of an episode together.

    Args:
      step: what happens in each of them.
      env: whose initial state and horizon count.
      draws: of the episode.
      check: called at each step; what it raises ends the work.

    Raises:
      NotLinearError: if a step is not piecewise linear in state and actions, if the law of a draw
        depends on the actions, or the end of the episode does.
      MissingDrawError: if the episode has not drawn what it would take.
    """
    program, weight = Program(), 1.0
    objective: Value = 0.0
    state: dict[Ground, Value] = {
        (name, place): np.asarray(env.sampler.init_values[name])[place].item()
        for name, place in step.following
    }
    nodes, bounds = step.needed(), _action_bounds(env)
    actions: list[Mapping[Ground, Affine]] = []
    for drawn in draws[: env.horizon]:
        check()
        actions.append({ground: program.variable(*ends) for ground, ends in bounds.items()})
        values = _Values(step, program, {Kind.STATE: state, Kind.ACTION: actions[-1]}, drawn)
        values.compute(nodes)
        _limit_actions(program, env, actions[-1])
        for node in step.legal:
            with contextlib.suppress(NotLinearError, MissingDrawError):
                legal = values.value(node)
                # without the others there are more plans, and a bound stays one
                if isinstance(legal, Affine):
                    program.require(legal, lower=1.0)
        for node in step.parameters:
            if isinstance(values.value(node), Affine):
                raise NotLinearError("a draw whose law depends on the actions")
        if any(values.value(node) is not False for node in step.ends):
            raise NotLinearError(_END)
        objective = objective + weight * values.value(step.reward)
        weight *= env.discount
        state = {ground: program.named(values.value(n)) for ground, n in step.following.items()}
    if 0 < len(draws) < env.horizon:
        # other actions may not have ended it there
        leaves = {Kind.STATE: state, Kind.ACTION: actions[-1]}
        last = _Values(step, program, leaves, draws[-1])
        last.compute(nodes)
        if not any(last.value(node) is True for node in step.ends):
            raise NotLinearError(_END)
    return Unrolled(program, objective, tuple(actions))


class _Values:
    """The values of a step's nodes."""

    def __init__(
        self,
        step: OneStep,
        program: Program,
        leaves: Mapping[int, Mapping[Ground, Value]],
        drawn: Mapping[int, np.ndarray],
    ) -> None:
        self._known: dict[int, Value | Piecewise] = {}
        self._graph, self._program, self._leaves, self._drawn = step.graph, program, leaves, drawn
        self._fluents, self._errors = step.fluents, dict[int, Exception]()

    def compute(self, nodes: list[int]) -> None:
        """Computes all, arguments first; what cannot be is told once it is asked for."""
        for node in nodes:
            failed = [self._errors[a] for a in self._graph.arguments[node] if a in self._errors]
            try:
                if failed:
                    raise failed[0]
                self._known[node] = self._compute(node)
            except (NotLinearError, MissingDrawError) as error:
                self._errors[node] = error

    def value(self, node: int) -> Value:
        """A node's value, or raises why it has none."""
        if node in self._errors:
            raise self._errors[node]
        return written(self._program, self._known[node])

    def _compute(self, node: int) -> Value | Piecewise:
        graph = self._graph
        operator, name = graph.operators[node], graph.values[node]
        if operator == "constant":
            return name
        if operator == "leaf":
            if graph.depends[node] == Kind.DRAWN:
                return self._draw(*name)
            return self._leaves[graph.depends[node]][name]
        arguments = [self._known[each] for each in graph.arguments[node]]
        value = applied(self._program, operator, arguments)
        # a fluent is one variable, so that conditions on it are functions of that
        if node not in self._fluents or isinstance(value, Piecewise):
            return value
        return self._program.named(value)

    def _draw(self, expression: int, place: tuple[int, ...]) -> Value:
        if expression not in self._drawn:
            raise MissingDrawError("a random number that the episode did not draw")
        value: Any = np.asarray(self._drawn[expression])
        return (value[place] if value.ndim else value).item()


def _action_bounds(env: RDDLEnv) -> dict[Ground, tuple[float, float, bool]]:
    """Per ground action its least and its largest value, and whether it is a whole number."""
    found: dict[Ground, tuple[float, float, bool]] = {}
    box, ranges = action_box(env), env.model.action_ranges
    for name, default in env.sampler.noop_actions.items():
        if ranges[name] not in _KINDS:
            raise NotLinearError(f"actions that are objects, {name}")
        shape = np.shape(default)
        lower, upper = (np.broadcast_to(end, shape).astype(float) for end in box[name])
        if ranges[name] == "bool":
            lower, upper = np.zeros(shape), np.ones(shape)
        for place in np.ndindex(shape):
            found[name, place] = float(lower[place]), float(upper[place]), ranges[name] != "real"
    return found


def _limit_actions(program: Program, env: RDDLEnv, actions: Mapping[Ground, Affine]) -> None:
    """At most so many bools that are true, where there are bools only, all false in the no-op."""
    most = env.model.max_allowed_actions
    values = list(actions.values())
    idle = not any(np.any(default) for default in env.sampler.noop_actions.values())
    if most < len(values) and idle and all(value.is_bool for value in values):
        terms = {variable: 1.0 for value in values for variable in value.terms}
        program.require(Affine(0.0, terms), upper=float(most))
