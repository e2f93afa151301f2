"""A problem as ground rules: of each next value its law, for every joint action."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.grounding import Ground, Grounder
from mdpo_rddl.problem.enumeration.joint_actions import action_variables, joint_actions
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.pace import Pace
from mdpo_rddl.problem.enumeration.packing import Packing, pack, sizes_of
from mdpo_rddl.problem.enumeration.rules import ActionRules, OpenRules, open_rules
from mdpo_rddl.problem.enumeration.substitution import Substitution
from mdpo_rddl.problem.legality import Referee, precondition_text
from mdpo_rddl.problem.limits import GroupLimit, group_limits
from mdpo_rddl.problem.load import Problem, make_environment

# of joint actions, by which it is told how long all take: the first ones make what others share
_FEWEST_LAWS = 8
# to find out whether an action is legal at the start, where none of the usual ones is
_START_SECONDS = 2.0


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


@dataclass(frozen=True)
class OpenModel:
    """A problem as ground rules, of which the action is left open.

    Attributes:
      graph: of all nodes.
      variables: ground state variables.
      is_bool: of each variable.
      ranges: of each variable "bool", "int" or the type of its objects.
      objects: names of each type's objects.
      first: of each variable its value in the initial state.
      actions: per ground action variable its default and its other values.
      legal: nodes of the preconditions, conjunctions taken apart.
      rules: of the next state and the expected reward.
      ends: node that is true in states where the episode ends.
      most: how many action variables may differ from their defaults.
      groups: preconditions that limit how many of a group of bools are true.
      horizon, discount: of the problem.
    """

    graph: Graph
    variables: tuple[Ground, ...]
    is_bool: tuple[bool, ...]
    ranges: tuple[str, ...]
    objects: Mapping[str, Sequence[str]]
    first: tuple[Any, ...]
    actions: Mapping[Ground, tuple[Any, list[Any]]]
    legal: tuple[int, ...]
    rules: OpenRules
    ends: int
    most: float
    groups: tuple[GroupLimit, ...]
    horizon: int
    discount: float

    def leaf(self, number: int) -> int:
        """The node that stands for a variable's value."""
        return self.graph.leaf(Kind.STATE, self.variables[number], self.is_bool[number])

    def defaults(self) -> dict[int, int]:
        """Of the leaf of each action variable the node of its default."""
        return self.constants({ground: default for ground, (default, _) in self.actions.items()})

    def constants(self, assignment: Mapping[Ground, Any]) -> dict[int, int]:
        """Of the leaf of each action variable the node of the value that is assigned to it."""
        return _constants(self.graph, Kind.ACTION, assignment)


def open_model(problem: Problem, limits: EnumerationLimits) -> OpenModel:
    """Grounds a problem, but for its actions.

    Raises:
      NotEnumerableError: if its states or actions are not discrete, the states not observed, or if
        an expression is not understood.
    """
    rddl = problem.model
    if rddl.observ_fluents:
        raise NotEnumerableError("the state is not observed")
    env = make_environment(problem)
    initial = env.sampler.init_values
    grounder = Grounder(rddl, initial, limits)
    variables = _places(rddl.state_fluents, initial)
    ranges = tuple(rddl.variable_ranges[name] for name, _ in variables)
    is_bool = tuple(kind == "bool" for kind in ranges)
    _sizes(ranges, rddl.type_to_objects)  # raises
    legal = _conjuncts(grounder, rddl.preconditions)
    rules = open_rules(grounder, rddl, list(zip(variables, is_bool, strict=True)), legal)
    first = [np.asarray(initial[name])[place].item() for name, place in variables]
    if _is_broken(grounder, rddl, dict(zip(variables, first, strict=True))):
        # the environment looks at them after a step only
        raise NotEnumerableError("the initial state breaks an invariant")
    return OpenModel(
        graph=grounder.graph,
        variables=tuple(variables),
        is_bool=is_bool,
        ranges=ranges,
        objects=rddl.type_to_objects,
        first=tuple(first),
        actions=action_variables(env),
        legal=tuple(legal),
        rules=rules,
        ends=_ends(grounder, rddl),
        most=env.model.max_allowed_actions,
        groups=tuple(group_limits(env.model)[0]),
        horizon=problem.horizon,
        discount=float(env.discount),
    )


def ground_model(
    problem: Problem, limits: EnumerationLimits, opened: OpenModel | None = None
) -> GroundModel:
    """Grounds a problem.

    Args:
      problem: the parsed problem.
      limits: for the time and the number of joint actions.
      opened: the model with the action left open, if there is one already.

    Raises:
      NotEnumerableError: if its states are not discrete or not observed, if an expression is
        not understood, or if there are too many actions.
    """
    model = open_model(problem, limits) if opened is None else opened
    packing = pack(_sizes(model.ranges, model.objects))
    try:
        start = packing.encode_all(model.first)
    except OverflowError as error:
        raise NotEnumerableError(str(error)) from error
    return GroundModel(
        graph=model.graph,
        variables=model.variables,
        is_bool=model.is_bool,
        groups=tuple(group for group in model.rules.groups if len(group) > 1),
        packing=packing,
        initial=start,
        actions=_per_action(model, limits),
        ends=model.ends,
        horizon=model.horizon,
        discount=model.discount,
    )


def require_actions(problem: Problem) -> None:
    """Raises `InputError` where there is nothing to plan."""
    if not problem.model.action_fluents:
        raise InputError(f"{problem.domain_path}: it has no action fluent, nothing to plan")


def require_legal_start(problem: Problem) -> None:
    """Raises `InputError` where an action is due in the initial state and none is legal.

    That is decided where a precondition does not hold whatever is done, and where all actions are
    discrete and not too many; elsewhere nothing is raised.
    """
    env = make_environment(problem)
    env.reset(seed=0)
    verdict = Referee(env).rule({})
    if env.done or not verdict.illegal or verdict.fallback:
        return
    try:
        in_the_way = _in_the_way(problem.model, env, EnumerationLimits(_START_SECONDS))
    except NotEnumerableError:
        return
    if in_the_way is not None:
        told = "; ".join([precondition_text(each) for each in in_the_way] or verdict.unmet)
        raise InputError(
            f"{problem.instance_path}: no action is legal in the initial state, by the "
            f"precondition {told}"
        )


def _in_the_way(rddl: Any, env: Any, limits: EnumerationLimits) -> list[Any] | None:
    """Which preconditions leave no action in the initial state; None if one is legal.

    Where they do it together, none is named.

    Raises:
      NotEnumerableError: if that is not known.
    """
    grounder = Grounder(rddl, env.sampler.init_values, limits)
    graph, initial = grounder.graph, env.sampler.init_values
    state = {
        each: np.asarray(initial[each[0]])[each[1]].item()
        for each in _places(rddl.state_fluents, initial)
    }
    values = _constants(graph, Kind.STATE, state)
    unread: NotEnumerableError | None = None
    nodes: list[int] = []
    for precondition in rddl.preconditions:
        try:
            found = _conjuncts(grounder, [precondition])
        except NotEnumerableError as error:
            unread = error
            continue
        nodes += graph.substitute(found, values)
        if graph.false in nodes:
            return [precondition]
    if unread is not None:
        raise unread
    read = graph.needed(nodes, Kind.ACTION)
    variables = {
        each: item
        for each, item in action_variables(env).items()
        if graph.leaf(Kind.ACTION, each, isinstance(item[0], bool)) in read
    }
    most, groups = env.model.max_allowed_actions, group_limits(env.model)[0]
    default, *others = joint_actions(variables, most, (graph, nodes), limits, groups)
    left = graph.substitute(nodes, _constants(graph, Kind.ACTION, default))
    return [] if not others and any(node != graph.true for node in left) else None


def _constants(graph: Graph, kind: int, values: Mapping[Ground, Any]) -> dict[int, int]:
    """Of the leaf of each variable the node of its value."""
    return {
        graph.leaf(kind, each, isinstance(value, bool)): graph.constant(value)
        for each, value in values.items()
    }


def _places(names: Iterable[str], values: Mapping[str, Any]) -> list[Ground]:
    return [(name, place) for name in names for place in np.ndindex(np.shape(values[name]))]


def _sizes(ranges: Sequence[str], objects: Mapping[str, Sequence[str]]) -> list[int | None]:
    try:
        return sizes_of(ranges, objects)
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
    values = _constants(graph, Kind.STATE, state)
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


def _per_action(model: OpenModel, limits: EnumerationLimits) -> tuple[ActionRules, ...]:
    """The rules with each joint action put in; of those with equal rules the first."""
    graph, whole, nodes = model.graph, model.rules, model.rules.nodes()
    leaves = [n for n in graph.needed(nodes, Kind.ACTION) if graph.operators[n] == "leaf"]
    read = {graph.values[leaf] for leaf in leaves}
    variables = {each: item for each, item in model.actions.items() if each in read}
    found: dict[tuple[int, ...], tuple[Mapping[Ground, Any], OpenRules]] = {}
    played: Substitution | None = None
    allowed = graph, model.legal
    for assignment in joint_actions(variables, model.most, allowed, limits, model.groups):
        limits.check_time()
        constants = model.constants(assignment)
        played = played or Substitution(graph, nodes, constants)  # the first is the default
        new = tuple(played(constants))
        if new not in found:
            found[new] = assignment, whole.with_nodes(new)
            found[new][1].check(graph)
    pace, closed = Pace(limits, "joint actions' laws"), list[ActionRules]()
    for played_actions, rules in found.values():
        if len(closed) >= _FEWEST_LAWS:
            pace.check(len(closed), len(found) - len(closed))
        closed.append(rules.closed(graph, played_actions, limits.check_time))
    return tuple(closed)
