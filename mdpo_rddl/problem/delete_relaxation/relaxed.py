"""A ground model without what makes a value be lost again: how literals and rewards are reached.

A next value is reached by playing nothing, one action, or two together, as its law says with these
put in and all others at their defaults: an action that is played and not played in one expression
would make what no play can. Two are those of few that the law reads, or one that is illegal alone
with another one that makes it legal. Beside that each literal and each reward is looked at by
itself.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from mdpo_rddl.problem.delete_relaxation.circuit import Assignment, Circuit, Literal
from mdpo_rddl.problem.delete_relaxation.conditions import Condition, conditions
from mdpo_rddl.problem.delete_relaxation.costs import Costs
from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.joint import leaves_of
from mdpo_rddl.problem.enumeration.laws import Branch, Law, law_nodes
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import OpenModel
from mdpo_rddl.problem.enumeration.substitution import Substitution

# values of actions that a law reads: pairs of more are not looked at
_MOST_PAIRED = 24
_MOST_ARGUMENTS = 500_000


@dataclass(frozen=True)
class Goal:
    """A condition of the reward.

    Attributes:
      cost: node of what it costs to make it hold.
      worth: of a step at which it holds.
      lasts: whether it may pay at one step after another: it reads no action.
    """

    cost: int
    worth: float
    lasts: bool


@dataclass(frozen=True)
class Relaxed:
    """The delete relaxation of a ground model.

    Attributes:
      circuit: of all costs.
      steps: per literal the node of what it costs to make it true at the next step, that step not
        counted.
      goals: what pays.
    """

    circuit: Circuit
    steps: Mapping[Literal, int]
    goals: tuple[Goal, ...]


def relaxed(model: OpenModel, limits: EnumerationLimits) -> Relaxed:
    """The delete relaxation.

    Args:
      model: whose graph grows.
      limits: for the time.

    Raises:
      NotEnumerableError: if it becomes too large, or there is no reward that has to be reached.
    """
    made = _Relaxation(model, limits)
    goals = made.goals()
    if not goals:
        raise NotEnumerableError("no reward that must be reached")
    return Relaxed(made.circuit, made.steps(), goals)


def changes_integers(model: OpenModel) -> bool:
    """Whether actions change integers, about which the relaxation knows nothing."""
    rules, graph = model.rules, model.graph
    kinds = zip(rules.laws, model.ranges, strict=True)
    nodes = [node for law, kind in kinds if kind == "int" for node in law_nodes(law)]
    drawn = leaves_of(graph, nodes, rules.drawn)
    nodes += [node for leaf in drawn for node in law_nodes(rules.drawn[leaf])]
    return any(graph.depends[node] & Kind.ACTION for node in nodes)


class _Relaxation:
    """Makes the circuit."""

    def __init__(self, model: OpenModel, limits: EnumerationLimits) -> None:
        self.circuit = Circuit()
        self._model, self._limits = model, limits
        self._costs = Costs(model, self.circuit)
        self._defaults = model.defaults()
        graph = model.graph
        grounds = list(model.actions)
        self._leaves = [
            graph.leaf(Kind.ACTION, ground, isinstance(model.actions[ground][0], bool))
            for ground in grounds
        ]
        self._values = [[graph.constant(each) for each in model.actions[g][1]] for g in grounds]
        self._numbers = {leaf: number for number, leaf in enumerate(self._leaves)}
        # places of the preconditions that read each action, and these with actions put in
        self._limiting: dict[int, list[int]] = {}
        for place, node in enumerate(model.legal):
            for leaf in self._read([node]):
                self._limiting.setdefault(leaf, []).append(place)
        self._preconditions = Substitution(graph, model.legal, self._defaults)
        self._legal: dict[Assignment, int] = {}

    def steps(self) -> dict[Literal, int]:
        """Per literal the node of its cost at the next step; of all that are read."""
        found: dict[Literal, int] = {}
        known: set[int] = set()
        while waiting := {each.variable for each in self.circuit.literals} - known:
            for variable in sorted(waiting):
                found |= self._of_variable(variable)
            known |= waiting
        return {each: found[each] for each in self.circuit.literals}

    def goals(self) -> tuple[Goal, ...]:
        """The conditions of the reward that cost something; equal ones count together."""
        graph, reward = self._model.graph, self._model.rules.reward
        worth: dict[tuple[int, bool], float] = {}
        for condition in conditions(graph, reward, self._limits):
            cost = self._reached(condition)
            if cost not in (self.circuit.free, self.circuit.impossible):
                key = cost, not self._read(condition.nodes)
                worth[key] = worth.get(key, 0.0) + condition.worth
        return tuple(Goal(cost, total, lasts) for (cost, lasts), total in worth.items())

    def _reached(self, condition: Condition) -> int:
        """The cheapest way to make a condition hold."""
        return self.circuit.least(
            self.circuit.total([legal, self._held(condition, new, costs)])
            for legal, new, costs in self._played(condition.nodes)
        )

    def _held(self, condition: Condition, nodes: Sequence[int], costs: Costs) -> int:
        parts = [
            costs.truth(node, wanted) for node, wanted in zip(nodes, condition.wanted, strict=True)
        ]
        return self.circuit.least(parts) if condition.is_any else self.circuit.total(parts)

    def _of_variable(self, variable: int) -> dict[Literal, int]:
        law, is_bool = self._model.rules.laws[variable], self._model.is_bool[variable]
        nodes = law_nodes(law)
        found: dict[int, list[int]] = {value: [] for value in self._costs.values(variable)}
        for legal, new, costs in self._played(nodes):
            given = _law(new)
            for value, ways in found.items():
                becomes = costs.becomes(given, value, is_bool)
                ways.append(self.circuit.total([legal, becomes]))
        return {Literal(variable, value): self.circuit.least(each) for value, each in found.items()}

    def _played(self, nodes: Sequence[int]) -> Iterator[tuple[int, list[int], Costs]]:
        """The nodes with the actions put in that they read, themselves or by what is drawn.

        Yields:
          What it costs to play the actions, the nodes, and the costs of what they read.
        """
        graph, drawn = self._model.graph, self._model.rules.drawn
        leaves = sorted(leaves_of(graph, nodes, drawn))
        moved = [leaf for leaf in leaves if self._read(law_nodes(drawn[leaf]))]
        every = [*nodes, *(node for leaf in moved for node in law_nodes(drawn[leaf]))]
        put = Substitution(graph, every, self._defaults)

        def given(assignment: Assignment) -> tuple[list[int], Costs]:
            new = put(self._given(assignment))
            if not moved:
                return new, self._costs
            rest, laws = iter(new[len(nodes) :]), dict(drawn)
            for leaf in moved:
                laws[leaf] = _law([next(rest) for _ in law_nodes(drawn[leaf])])
            return new[: len(nodes)], Costs(self._model, self.circuit, laws)

        read = sorted(self._numbers[leaf] for leaf in self._read(every))
        single = [(number, value) for number in read for value in range(len(self._values[number]))]
        yield self.circuit.free, *given(())
        assignments: list[Assignment] = [(each,) for each in single]
        if len(single) <= _MOST_PAIRED:
            assignments += [pair for pair in combinations(single, 2) if pair[0][0] != pair[1][0]]
        assignments += [pair for each in single for pair in self._completed(each)]
        for assignment in dict.fromkeys(assignments):
            self._limits.check_time()
            if self.circuit.size > _MOST_ARGUMENTS:
                raise NotEnumerableError("the relaxation becomes too large")
            if len(assignment) > self._model.most:
                continue
            cost = self._legal_cost(assignment)
            if cost != self.circuit.impossible:
                yield cost, *given(assignment)

    def _completed(self, single: tuple[int, int]) -> list[Assignment]:
        """An action that is never legal alone, with another one that its preconditions read."""
        if self._legal_cost((single,)) != self.circuit.impossible:
            return []
        limiting = self._limiting.get(self._leaves[single[0]], ())
        leaves = self._read([self._model.legal[place] for place in limiting])
        others = {self._numbers[leaf] for leaf in leaves} - {single[0]}
        pairs: list[Assignment] = [
            tuple(sorted([single, (number, value)]))
            for number in others
            for value in range(len(self._values[number]))
        ]
        return sorted(pairs) if len(pairs) <= _MOST_PAIRED else []

    def _legal_cost(self, assignment: Assignment) -> int:
        """The node of what it costs to make actions legal that are played together."""
        if assignment not in self._legal:
            given = self._given(assignment)
            places = sorted({place for leaf in given for place in self._limiting.get(leaf, ())})
            nodes = self._preconditions(given, places) if places else []
            holds = [self._costs.truth(node, True) for node in nodes]
            self._legal[assignment] = self.circuit.played(self.circuit.total(holds), assignment)
        return self._legal[assignment]

    def _given(self, assignment: Assignment) -> dict[int, int]:
        """The nodes in place of the leaves of actions that are played."""
        return {self._leaves[number]: self._values[number][value] for number, value in assignment}

    def _read(self, nodes: Sequence[int]) -> list[int]:
        """The leaves of actions that the nodes read."""
        graph = self._model.graph
        needed = graph.needed(nodes, Kind.ACTION)
        return [each for each in needed if graph.operators[each] == "leaf"]


def _law(nodes: Sequence[int]) -> Law:
    return tuple(Branch(*pair) for pair in zip(nodes[::2], nodes[1::2], strict=True))
