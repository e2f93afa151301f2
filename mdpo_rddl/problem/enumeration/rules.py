"""What follows an action, as nodes of a graph: with the action left open, and put in."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mdpo_rddl.problem.enumeration.expectation import expectation
from mdpo_rddl.problem.enumeration.graph import Graph
from mdpo_rddl.problem.enumeration.grounding import Ground, Grounder
from mdpo_rddl.problem.enumeration.joint import (
    JointLaw,
    check_combinations,
    joint_law,
    leaves_of,
    nodes_of,
)
from mdpo_rddl.problem.enumeration.laws import Branch, Law, Laws


@dataclass(frozen=True)
class ActionRules:
    """What follows a joint action.

    Attributes:
      assignment: of every ground action variable that matters.
      laws: per state variable the law of its next value, independent of the others; of a bool
        one branch, whose value is the probability of true; of a variable of a group nothing.
      joint: per group the law of its variables' next values.
      reward: node of the expected reward.
      legal: node of the preconditions.
    """

    assignment: Mapping[Ground, Any]
    laws: tuple[Law, ...]
    joint: tuple[JointLaw, ...]
    reward: int
    legal: int

    def nodes(self) -> list[int]:
        """All nodes."""
        of_laws = [node for law in self.laws for branch in law for node in branch]
        of_groups = [node for law in self.joint for node in nodes_of(law)]
        return [self.reward, self.legal, *of_laws, *of_groups]


@dataclass(frozen=True)
class OpenRules:
    """The rules with the action left open.

    Attributes:
      laws: per state variable that of its next value, which may read drawn leaves.
      is_bool: of each variable.
      drawn: the laws of the leaves that they read.
      groups: of variables that read the same leaves, also of one.
      reward, legal: as in `ActionRules`.
    """

    laws: tuple[Law, ...]
    is_bool: tuple[bool, ...]
    drawn: Mapping[int, Law]
    groups: tuple[tuple[int, ...], ...]
    reward: int
    legal: int

    def nodes(self) -> list[int]:
        """All nodes, in the order in which `with_nodes` takes them."""
        laws = [*self.laws, *self.drawn.values()]
        return [self.reward, self.legal, *(n for law in laws for branch in law for n in branch)]

    def with_nodes(self, nodes: Sequence[int]) -> "OpenRules":
        """The same with other nodes."""
        reward, legal, *rest = nodes
        left = iter(rest)
        new = [
            tuple(Branch(next(left), next(left)) for _ in law)
            for law in (*self.laws, *self.drawn.values())
        ]
        laws, drawn = new[: len(self.laws)], new[len(self.laws) :]
        return replace(
            self,
            laws=tuple(laws),
            drawn=dict(zip(self.drawn, drawn, strict=True)),
            reward=reward,
            legal=legal,
        )

    def check(self, graph: Graph) -> None:
        """Raises `NotEnumerableError` where `closed` would find too much, at once."""
        for group in self.groups:
            nodes = [node for number in group for branch in self.laws[number] for node in branch]
            check_combinations(graph, nodes, self.drawn)

    def closed(
        self, graph: Graph, assignment: Mapping[Ground, Any], check_time: Callable[[], None]
    ) -> ActionRules:
        """The rules of an action that was put in, with nothing left that is drawn."""
        laws, joint = list(self.laws), []
        for group in self.groups:
            own = [(self.laws[number], self.is_bool[number]) for number in group]
            law = joint_law(graph, own, self.drawn, check_time)
            for number in group:
                laws[number] = ()
            if len(group) > 1:
                joint.append(law)
                continue
            alone = tuple(Branch(value, probability) for (value,), probability in law)
            if self.is_bool[group[0]]:
                alone = (Branch(Laws(graph).truth(alone), graph.one),)
            laws[group[0]] = alone
        return ActionRules(assignment, tuple(laws), tuple(joint), self.reward, self.legal)


def open_rules(
    grounder: Grounder, rddl: Any, variables: Sequence[tuple[Ground, bool]], legal: Sequence[int]
) -> OpenRules:
    """The rules of a problem.

    Args:
      grounder: of its expressions.
      rddl: pyRDDLGym's lifted model.
      variables: ground state variables, and whether each is a bool.
      legal: nodes of the preconditions.

    Raises:
      NotEnumerableError: for what is not understood.
    """
    graph, laws = grounder.graph, []
    for (name, place), is_bool in variables:
        law = grounder.fluent(f"{name}'", place)
        laws.append((Branch(grounder.laws.truth(law), graph.one),) if is_bool else law)
    reward = grounder.laws.mean(grounder.law(rddl.reward, {}))
    drawn: dict[int, Law] = {}
    while waiting := {g: leaf for g, leaf in grounder.drawn.items() if leaf not in drawn}:
        drawn |= {leaf: grounder.fluent(*ground) for ground, leaf in waiting.items()}
    own = [grounder.drawn.get((f"{name}'", place)) for (name, place), _ in variables]
    laws, reads = _read_leaves(graph, laws, own, drawn)
    return OpenRules(
        laws=tuple(laws),
        is_bool=tuple(is_bool for _, is_bool in variables),
        drawn={leaf: drawn[leaf] for leaf in sorted(set().union(*reads))},
        groups=_groups(reads),
        reward=expectation(graph, reward, drawn),
        legal=graph.make("and", *legal, graph.true),
    )


def _read_leaves(
    graph: Graph, laws: Sequence[Law], own: Sequence[int | None], drawn: Mapping[int, Law]
) -> tuple[list[Law], list[set[int]]]:
    """The laws of variables, and the leaves that each of them reads.

    A variable whose next value another one reads is the leaf that stands for it.

    Args:
      graph: of the nodes.
      laws: of the variables.
      own: of each variable the leaf that stands for its next value, if there is one.
      drawn: laws of all leaves.
    """
    reads = [leaves_of(graph, (n for b in law for n in b), drawn) for law in laws]
    wanted = set().union(*reads)
    laws = list(laws)
    for number, leaf in enumerate(own):
        if leaf is not None and leaf in wanted:
            laws[number] = (Branch(leaf, graph.one),)
            reads[number] = leaves_of(graph, [leaf], drawn)
    return laws, reads


def _groups(reads: Sequence[set[int]]) -> tuple[tuple[int, ...], ...]:
    """The variables that share leaves, directly or by others; those that read none are left out."""
    groups: list[tuple[set[int], list[int]]] = []
    for number, leaves in enumerate(reads):
        if not leaves:
            continue
        sharing = [group for group in groups if group[0] & leaves]
        groups = [group for group in groups if not group[0] & leaves]
        groups.append(
            (
                leaves.union(*(theirs for theirs, _ in sharing)),
                [*(one for _, members in sharing for one in members), number],
            )
        )
    return tuple(tuple(sorted(members)) for _, members in groups)
