"""A problem as ground rules: of each next value its law, for every joint action."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.grounding import Ground, Grounder
from mdpo_rddl.problem.enumeration.joint_actions import action_variables, joint_actions
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.packing import Packing, pack, sizes_of
from mdpo_rddl.problem.enumeration.rules import ActionRules, OpenRules, open_rules
from mdpo_rddl.problem.enumeration.substitution import Substitution
from mdpo_rddl.problem.limits import group_limits
from mdpo_rddl.problem.load import Problem, make_environment


@dataclass(frozen=True)
class GroundModel:
    """All that an enumeration needs to know about a problem.

    Attributes:
      graph: of all nodes.
      variables: ground state variables.
      is_bool: of each variable.
      groups: numbers of variables whose next values are not independent of each other.
      packing: of all variables.
      initial: packed initial state [words].
      actions: rules per joint action; the first one is the default action.
      ends: node that is true in states where the episode ends.
      horizon, discount: of the problem.
    """

    graph: Graph
    variables: tuple[Ground, ...]
    is_bool: tuple[bool, ...]
    groups: tuple[tuple[int, ...], ...]
    packing: Packing
    initial: np.ndarray
    actions: tuple[ActionRules, ...]
    ends: int
    horizon: int
    discount: float

    def leaf(self, number: int) -> int:
        """The node that stands for a variable's value."""
        return self.graph.leaf(Kind.STATE, self.variables[number], self.is_bool[number])


def ground_model(problem: Problem, limits: EnumerationLimits) -> GroundModel:
    """Grounds a problem.

    Raises:
      NotEnumerableError: if its states are not discrete or not observed, if an expression is
        not understood, or if there are too many actions.
    """
    rddl = problem.model
    if rddl.observ_fluents:
        raise NotEnumerableError("the state is not observed")
    env = make_environment(problem)
    initial = env.sampler.init_values
    grounder = Grounder(rddl, initial, limits)
    variables = _places(rddl.state_fluents, initial)
    is_bool = tuple(rddl.variable_ranges[name] == "bool" for name, _ in variables)
    packing = pack(_sizes(rddl, variables))
    legal = _conjuncts(grounder, rddl.preconditions)
    rules = open_rules(grounder, rddl, list(zip(variables, is_bool, strict=True)), legal)
    first = [np.asarray(initial[name])[place].item() for name, place in variables]
    try:
        start = packing.encode_all(first)
    except OverflowError as error:
        raise NotEnumerableError(str(error)) from error
    if _is_broken(grounder, rddl, dict(zip(variables, first, strict=True))):
        # the environment looks at them after a step only
        raise NotEnumerableError("the initial state breaks an invariant")
    return GroundModel(
        graph=grounder.graph,
        variables=tuple(variables),
        is_bool=is_bool,
        groups=tuple(group for group in rules.groups if len(group) > 1),
        packing=packing,
        initial=start,
        actions=_per_action(env, grounder.graph, rules, legal, limits),
        ends=_ends(grounder, rddl),
        horizon=problem.horizon,
        discount=float(env.discount),
    )


def _places(names: Iterable[str], values: Mapping[str, Any]) -> list[Ground]:
    return [(name, place) for name in names for place in np.ndindex(np.shape(values[name]))]


def _sizes(rddl: Any, variables: Sequence[Ground]) -> list[int | None]:
    try:
        return sizes_of([rddl.variable_ranges[name] for name, _ in variables], rddl.type_to_objects)
    except KeyError as error:
        raise NotEnumerableError(f"{error.args[0]} fluents in the state") from None


def _conjuncts(grounder: Grounder, expressions: Iterable[Any]) -> list[int]:
    """The nodes of the expressions, with conjunctions taken apart."""
    graph = grounder.graph
    found: list[int] = []
    for node in [grounder.node(each, {}) for each in expressions]:
        found += graph.arguments[node] if graph.operators[node] == "and" else [node]
    return found


def _is_broken(grounder: Grounder, rddl: Any, state: Mapping[Ground, Any]) -> bool:
    """Whether a state breaks an invariant."""
    graph = grounder.graph
    values = {
        graph.leaf(Kind.STATE, each, isinstance(value, bool)): graph.constant(value)
        for each, value in state.items()
    }
    nodes = [grounder.node(each, {}) for each in rddl.invariants]
    return any(node == graph.false for node in graph.substitute(nodes, values))


def _ends(grounder: Grounder, rddl: Any) -> int:
    graph = grounder.graph
    terminal = [grounder.node(each, {}) for each in rddl.terminations]
    broken = [graph.make("not", grounder.node(each, {})) for each in rddl.invariants]
    node = graph.make("or", *terminal, *broken, graph.false)
    if graph.depends[node] & ~Kind.STATE:
        raise NotEnumerableError("a termination that reads more than the state")
    return node


def _per_action(
    env: Any, graph: Graph, whole: OpenRules, legal: Sequence[int], limits: EnumerationLimits
) -> tuple[ActionRules, ...]:
    """The rules with each joint action put in; of those with equal rules the first."""
    nodes = whole.nodes()
    leaves = [n for n in graph.needed(nodes, Kind.ACTION) if graph.operators[n] == "leaf"]
    read = {graph.values[leaf] for leaf in leaves}
    variables = {each: item for each, item in action_variables(env).items() if each in read}
    most = env.model.max_allowed_actions
    found: dict[tuple[int, ...], tuple[Mapping[Ground, Any], OpenRules]] = {}
    groups = group_limits(env.model)[0]
    played: Substitution | None = None
    for assignment in joint_actions(variables, most, (graph, legal), limits, groups):
        limits.check_time()
        constants = {
            graph.leaf(Kind.ACTION, each, isinstance(value, bool)): graph.constant(value)
            for each, value in assignment.items()
        }
        played = played or Substitution(graph, nodes, constants)  # the first is the default
        new = tuple(played(constants))
        if new not in found:
            found[new] = assignment, whole.with_nodes(new)
            found[new][1].check(graph)
    return tuple(
        rules.closed(graph, assignment, limits.check_time) for assignment, rules in found.values()
    )
