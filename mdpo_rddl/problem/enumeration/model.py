"""A problem as ground rules: of each next value its law, for every joint action."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.grounding import Ground, Grounder
from mdpo_rddl.problem.enumeration.joint_actions import action_variables, joint_actions
from mdpo_rddl.problem.enumeration.laws import Branch, Law
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.packing import Packing, pack, sizes_of
from mdpo_rddl.problem.load import Problem, make_environment


@dataclass(frozen=True)
class ActionRules:
    """What follows a joint action.

    Attributes:
      assignment: of every ground action variable that matters.
      laws: per variable of the model, the law of its next value; of a bool one branch, whose
        value is the probability of true.
      reward: node of the expected reward.
      legal: node of the preconditions.
    """

    assignment: Mapping[Ground, Any]
    laws: tuple[Law, ...]
    reward: int
    legal: int

    def nodes(self) -> list[int]:
        """All nodes."""
        return [self.reward, self.legal, *(node for law in self.laws for each in law for node in each)]


@dataclass(frozen=True)
class GroundModel:
    """All that an enumeration needs to know about a problem.

    Attributes:
      graph: of all nodes.
      variables: ground state variables, then random ones that others of the same step read.
      state_variables: how many of them make the state.
      is_bool: of each variable.
      packing: of all variables.
      stages: of each variable, after how many rounds of draws its law is known.
      initial: packed initial state [words].
      actions: rules per joint action; the first one is the default action.
      ends: node that is true in states where the episode ends.
      horizon, discount: of the problem.
    """

    graph: Graph
    variables: tuple[Ground, ...]
    state_variables: int
    is_bool: tuple[bool, ...]
    packing: Packing
    stages: tuple[int, ...]
    initial: np.ndarray
    actions: tuple[ActionRules, ...]
    ends: int
    horizon: int
    discount: float


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
    initial_values = env.sampler.init_values
    grounder = Grounder(rddl, initial_values, limits)
    graph = grounder.graph
    states = _places(rddl.state_fluents, initial_values)
    _sizes(rddl, states)
    laws = [grounder.fluent(f"{name}'", place) for name, place in states]
    reward = grounder.laws.mean(grounder.law(rddl.reward, {}))
    legal = _conjuncts(graph, [grounder.node(each, {}) for each in rddl.preconditions])
    ends = _ends(grounder, rddl)
    drawn = _close(grounder)
    variables = (*states, *drawn)
    laws += [grounder.fluent(*each) for each in drawn]
    is_bool = tuple(rddl.variable_ranges[name] == "bool" for name, _ in variables)
    packed = [
        (Branch(grounder.laws.truth(law), graph.one),) if boolean else law
        for law, boolean in zip(laws, is_bool, strict=True)
    ]
    whole = ActionRules({}, tuple(packed), reward, graph.make("and", *legal, graph.true))
    packing = pack(_sizes(rddl, variables))
    first = [np.asarray(initial_values[name])[place].item() for name, place in states]
    return GroundModel(
        graph=graph,
        variables=variables,
        state_variables=len(states),
        is_bool=is_bool,
        packing=packing,
        stages=_stages(graph, variables, packed, len(states)),
        initial=packing.encode_all(first),
        actions=_per_action(env, graph, whole, legal, limits),
        ends=ends,
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


def _conjuncts(graph: Graph, nodes: Iterable[int]) -> list[int]:
    """The nodes, with conjunctions taken apart."""
    found: list[int] = []
    for node in nodes:
        found += graph.arguments[node] if graph.operators[node] == "and" else [node]
    return found


def _ends(grounder: Grounder, rddl: Any) -> int:
    graph = grounder.graph
    terminal = [grounder.node(each, {}) for each in rddl.terminations]
    broken = [graph.make("not", grounder.node(each, {})) for each in rddl.invariants]
    node = graph.make("or", *terminal, *broken, graph.false)
    if graph.depends[node] & ~Kind.STATE:
        raise NotEnumerableError("a termination that reads more than the state")
    return node


def _close(grounder: Grounder) -> list[Ground]:
    """Random fluents of the step that others read, their own laws made; next states left out."""
    done = 0
    while done < len(grounder.drawn):
        grounder.fluent(*grounder.drawn[done])
        done += 1
    return [ground for ground in grounder.drawn if not ground[0].endswith("'")]


def _stages(
    graph: Graph, variables: Sequence[Ground], laws: Sequence[Law], states: int
) -> tuple[int, ...]:
    """After how many rounds of draws each law can be evaluated."""
    names = [
        (f"{name}'", place) if number < states else (name, place)
        for number, (name, place) in enumerate(variables)
    ]
    reads = []
    for law in laws:
        nodes = graph.needed([node for each in law for node in each], Kind.DRAWN)
        leaves = [graph.values[node] for node in nodes if graph.operators[node] == "leaf"]
        reads.append([names.index(leaf) for leaf in leaves])
    stages = [0] * len(laws)
    for _ in laws:
        new = [1 + max(stages[each] for each in read) if read else 0 for read in reads]
        if new == stages:
            return tuple(stages)
        stages = new
    raise NotEnumerableError("fluents of a step that depend on each other")


def _per_action(
    env: Any, graph: Graph, whole: ActionRules, legal: Sequence[int], limits: EnumerationLimits
) -> tuple[ActionRules, ...]:
    """The rules with each joint action put in; of those with equal rules the first."""
    nodes = whole.nodes()
    read = {graph.values[n] for n in graph.needed(nodes, Kind.ACTION) if graph.operators[n] == "leaf"}
    variables = {each: item for each, item in action_variables(env).items() if each in read}
    most = env.model.max_allowed_actions
    found: dict[tuple[int, ...], ActionRules] = {}
    for assignment in joint_actions(variables, most, (graph, legal), limits):
        limits.check_time()
        constants = {
            graph.leaf(Kind.ACTION, each, isinstance(value, bool)): graph.constant(value)
            for each, value in assignment.items()
        }
        new = tuple(graph.substitute(nodes, constants))
        if new not in found:
            found[new] = _with_nodes(assignment, whole.laws, new)
    return tuple(found.values())


def _with_nodes(
    assignment: Mapping[Ground, Any], laws: Sequence[Law], nodes: Sequence[int]
) -> ActionRules:
    reward, legal, *rest = nodes
    left = iter(rest)
    new = tuple(tuple(Branch(next(left), next(left)) for _ in law) for law in laws)
    return ActionRules(assignment, new, reward, legal)
