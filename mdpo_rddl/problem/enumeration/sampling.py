"""Next states and rewards of a ground model whose action is left open, drawn side by side."""

from typing import NamedTuple

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.joint import ordered_leaves
from mdpo_rddl.problem.enumeration.laws import Law, law_nodes
from mdpo_rddl.problem.enumeration.layered_program import Evaluated, LayeredProgram
from mdpo_rddl.problem.enumeration.model import OpenModel


class Stepped(NamedTuple):
    """What follows N states and actions.

    Attributes:
      states: next values [V, N].
      rewards: expected ones [N].
      ends: whether the episode ends with the next state [N].
    """

    states: np.ndarray
    rewards: np.ndarray
    ends: np.ndarray


class GroundSampler:
    """Samples a ground model.

    Attributes:
      is_random: whether any next value is drawn.
      draws: uniform numbers that a step takes.
      rows: nodes whose values it holds at once.
    """

    def __init__(self, model: OpenModel) -> None:
        """Finds the order of all draws."""
        self._model, graph = model, model.graph
        self._states = [model.leaf(number) for number in range(len(model.variables))]
        self._is_bool = np.array(model.is_bool, bool)
        defaults = [(ground, default) for ground, (default, _) in model.actions.items()]
        self._actions = [
            graph.leaf(Kind.ACTION, ground, isinstance(default, bool))
            for ground, default in defaults
        ]
        self._legal_node = graph.make("and", *model.legal, graph.true)
        self._legal = LayeredProgram(graph, [self._legal_node])
        self._ends = LayeredProgram(graph, [model.ends])
        laws, self._reward = model.rules.laws, model.rules.reward
        nodes, drawn = [node for law in laws for node in law_nodes(law)], model.rules.drawn
        self._main = LayeredProgram(graph, [self._reward, *nodes])
        self._drawn = [
            (leaf, LayeredProgram(graph, law_nodes(drawn[leaf])))
            for leaf in ordered_leaves(graph, nodes, drawn)
        ]
        self.rows = self._main.size + self._legal.size
        self.draws = len(self._drawn) + len(self._states)
        self.is_random = bool(self._drawn) or not all(
            len(law) == 1 and (graph.is_bool[law[0].value] or not is_bool)
            for law, is_bool in zip(laws, model.is_bool, strict=True)
        )

    def legal(self, states: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Whether the preconditions hold [N].

        Args:
          states: values of all state variables [V, N].
          actions: of all action variables [A, N], in the model's order.
        """
        values = self._legal.run(self._leaves(states, actions), states.shape[1])
        return values[self._legal_node].astype(bool)

    def step(self, states: np.ndarray, actions: np.ndarray, uniform: np.ndarray) -> Stepped:
        """What follows.

        Args:
          states: values of all state variables [V, N].
          actions: of all action variables [A, N], in the model's order.
          uniform: numbers between 0 and 1 [draws, N].
        """
        leaves, laws = self._leaves(states, actions), self._model.rules
        count = states.shape[1]
        for number, (leaf, program) in enumerate(self._drawn):
            values = program.run(leaves, count)
            leaves[leaf] = _drawn(laws.drawn[leaf], values, uniform[number], is_law_of_bool=False)
        values = self._main.run(leaves, count)
        following = np.empty_like(states)
        rest = uniform[len(self._drawn) :]
        for number, law in enumerate(laws.laws):
            is_bool = bool(self._is_bool[number])
            following[number] = _drawn(law, values, rest[number], is_law_of_bool=is_bool)
        ended = self._ends.run(self._leaves(following, None), count)[self._model.ends]
        return Stepped(following, values[self._reward], ended.astype(bool))

    def _leaves(self, states: np.ndarray, actions: np.ndarray | None) -> dict[int, np.ndarray]:
        found = dict(zip(self._states, states, strict=True))
        if actions is not None:
            found |= dict(zip(self._actions, actions, strict=True))
        return found


def _drawn(law: Law, values: Evaluated, uniform: np.ndarray, is_law_of_bool: bool) -> np.ndarray:
    """Values [N] drawn by a law; that of a bool may be the probability of true."""
    if is_law_of_bool:
        return uniform < values[law[0].value]
    found = values[law[-1].value].astype(np.int64)
    below = np.zeros(uniform.shape)
    is_open = np.ones(uniform.shape, bool)
    for branch in law[:-1]:
        below = below + values[branch.probability]
        hit = is_open & (uniform < below)
        found = np.where(hit, values[branch.value], found)
        is_open &= ~hit
    return found
