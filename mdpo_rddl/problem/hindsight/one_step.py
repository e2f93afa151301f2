"""One step of a problem as ground expressions of the state, the action and what is drawn."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.grounding import Binding, Ground, Grounder
from mdpo_rddl.problem.enumeration.laws import Law
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.hindsight.draws import CERTAIN, DrawsSimulator


@dataclass(frozen=True)
class OneStep:
    """What happens in a step, as nodes of a graph.

    Attributes:
      graph: of all nodes; a drawn leaf is named by its expression's number and its place.
      following: per ground state fluent the node of its next value.
      reward: its node.
      legal: nodes of the preconditions.
      ends: nodes of what ends the episode where it is true, read in a state.
      parameters: nodes that the laws of the draws depend on.
      fluents: nodes of all fluents that the step gives a value.
    """

    graph: Graph
    following: dict[Ground, int]
    reward: int
    legal: tuple[int, ...]
    ends: tuple[int, ...]
    parameters: tuple[int, ...]
    fluents: frozenset[int]

    def needed(self) -> list[int]:
        """All nodes, arguments first."""
        nodes = [*self.following.values(), self.reward, *self.legal, *self.ends, *self.parameters]
        return self.graph.needed(nodes)


def one_step(simulator: DrawsSimulator, limits: EnumerationLimits) -> OneStep:
    """Grounds a step.

    Args:
      simulator: of the problem.
      limits: for the time.

    Raises:
      NotEnumerableError: for what is not understood.
    """
    rddl, values = simulator.rddl, simulator.init_values
    grounder = _RevealedGrounder(simulator, limits)
    following = {
        (name, place): grounder.fluent(f"{name}'", place)[0].value
        for name in rddl.state_fluents
        for place in _places(values[name])
    }
    reward = grounder.law(rddl.reward, {})[0].value
    graph = grounder.graph
    broken = [graph.make("not", grounder.node(each, {})) for each in rddl.invariants]
    ends = [*broken, *(grounder.node(each, {}) for each in rddl.terminations)]
    legal: list[int] = []
    for each in rddl.preconditions:
        node = grounder.node(each, {})
        legal += graph.arguments[node] if graph.operators[node] == "and" else [node]
    parameters = tuple(grounder.parameters)
    fluents = grounder.fluent_nodes
    return OneStep(graph, following, reward, tuple(legal), tuple(ends), parameters, fluents)


def _places(value: Any) -> list[tuple[int, ...]]:
    return list(np.ndindex(np.shape(value)))


class _RevealedGrounder(Grounder):
    """Grounds expressions whose draws are known: leaves like the state's.

    Attributes:
      parameters: nodes that the laws of the draws depend on.
    """

    def __init__(self, simulator: DrawsSimulator, limits: EnumerationLimits) -> None:
        super().__init__(simulator.rddl, simulator.init_values, limits)
        self.parameters: set[int] = set()
        self._traced = simulator.traced

    @property
    def fluent_nodes(self) -> frozenset[int]:
        """Nodes of all fluents that were grounded."""
        return frozenset(law[0].value for law in self._known.values())

    def law(self, expression: Any, binding: Binding) -> Law:
        """The law of an expression: one value."""
        kind, name = expression.etype
        if kind == "randomvector":
            raise NotEnumerableError(f"a draw of a vector, {name}")
        if kind != "randomvar":
            return super().law(expression, binding)
        if name in CERTAIN:
            return self.law(expression.args[0], binding)
        arguments = expression.args
        if name in ("Discrete", "UnnormDiscrete"):
            arguments = [weight for _, (_, weight) in expression.args[1:]]
        elif name.endswith("(p)"):
            raise NotEnumerableError(f"a draw from {name}")
        self.parameters |= {self.law(each, binding)[0].value for each in arguments}
        scope = self._traced.cached_objects_in_scope(expression) or []
        place = tuple(binding[variable] for variable, _ in scope)
        leaf = self.graph.leaf(Kind.DRAWN, (expression.id, place), name == "Bernoulli")
        return self.laws.certain(leaf)
