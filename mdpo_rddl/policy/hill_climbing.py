"""The first step of the shortest way to where a goal is nearer: enforced hill-climbing.

Costs that add up are the same on all ways from one place to another by which two things are done:
whoever fetches something, and takes it elsewhere, comes no nearer while he goes and fetches it. The
search is breadth-first along the helpful actions of a goal, in the states that follow where each
event happens that is likely (Hoffmann and Nebel, "The FF planning system: fast plan generation
through heuristic search", 2001).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.policy.ground_actions import MOST_VALUES, NOTHING, GroundActions, Proposal
from mdpo_rddl.problem.delete_relaxation.distances import Distances, Prices

# steps of a way, states of a search, and goals of a state that are searched for: guesses, tried on
# a few problems
_MOST_STEPS, _MOST_STATES, _MOST_GOALS = 12, 100, 2
# by which a goal must come nearer
_NEARER = 1e-3
# a random number that makes an event happen if its probability is above a half
_LIKELY = 0.5
# states that are remembered, with a goal each
_REMEMBERED = 200_000


class _Seen(NamedTuple):
    """What a goal costs in a state, and what helps on the way to it."""

    cost: float
    helpful: tuple[Proposal, ...]


class _Node(NamedTuple):
    """A state that a search has come to.

    Attributes:
      search: number of the search.
      state: values of all state variables [V].
      code: hash of the state.
      first: what was played in the first state of the search; nothing there.
      ends: whether the episode ends with it.
    """

    search: int
    state: np.ndarray
    code: int
    first: Proposal
    ends: bool = False


class HillClimbing:
    """Searches from many states side by side; what it has seen of states is kept for later."""

    def __init__(self, distances: Distances, actions: GroundActions) -> None:
        """Knows nothing yet.

        Args:
          distances: how far goals are.
          actions: of the same ground model.
        """
        self._distances, self._actions = distances, actions
        self._known: dict[tuple[int, int, Prices], _Seen] = {}

    def __getstate__(self) -> dict[str, Any]:
        """What it has seen stays here: another process sees it for itself."""
        return {**vars(self), "_known": {}}

    def first_steps(
        self, states: np.ndarray, promised: np.ndarray, left: int, prices: Prices
    ) -> list[tuple[int, Proposal]]:
        """What to play where it takes several steps to come nearer to what promises most.

        That is the first goal to which a way is found; one that can be had at once has none, so
        that this may be played instead of it. Where a step is enough, what promises most is told by
        the states that follow.

        Args:
          states: values of all state variables [V, N].
          promised: what each goal promises [G, N], 0 of one that is not looked for.
          left: steps that a way may have.
          prices: what ways cost.

        Returns:
          Numbers of states, with the first steps to a few goals as far as they go together.
        """
        searches = [
            (place, goal)
            for place in range(states.shape[1])
            for goal in np.argsort(-promised[:, place], kind="stable")[:_MOST_GOALS].tolist()
            if promised[goal, place] > 0.0
        ]
        found = self._searched(states, searches, (left, prices))
        ways: dict[int, list[tuple[int, Proposal]]] = {}
        for (place, _), way in zip(searches, found, strict=True):
            if way is not None:
                ways.setdefault(place, []).append(way)
        far = [(place, [first for _, first in own]) for place, own in ways.items() if own[0][0] > 1]
        return self._actions.joint(states, far)

    def _searched(
        self, states: np.ndarray, searches: Sequence[tuple[int, int]], limits: tuple[int, Prices]
    ) -> list[tuple[int, Proposal] | None]:
        """Of each search the steps of the shortest way and the first of them; None without one.

        Args:
          states: values of all state variables [V, N].
          searches: of each the numbers of a state and of a goal.
          limits: steps that a way may have, and what ways cost.
        """
        left, prices = limits
        found: list[tuple[int, Proposal] | None] = [None] * len(searches)
        goals = [goal for _, goal in searches]
        codes = self._actions.codes(states).tolist()
        nodes = [
            _Node(number, states[:, place], codes[place], NOTHING)
            for number, (place, _) in enumerate(searches)
        ]
        reached = [{node.code} for node in nodes]
        seen = self._look(nodes, goals, prices)
        begun = [each.cost for each in seen]
        # nothing is nearer than what costs nothing
        far = [place for place, cost in enumerate(begun) if cost > _NEARER]
        nodes, seen = [nodes[place] for place in far], [seen[place] for place in far]
        for steps in range(1, min(_MOST_STEPS, left) + 1):
            nodes = self._followed(nodes, seen, reached)
            seen = self._look(nodes, goals, prices)
            for node, (cost, _) in zip(nodes, seen, strict=True):
                if found[node.search] is None and cost < begun[node.search] - _NEARER:
                    found[node.search] = steps, node.first
            open_ = [
                place
                for place, node in enumerate(nodes)
                if found[node.search] is None and not node.ends
            ]
            nodes, seen = [nodes[place] for place in open_], [seen[place] for place in open_]
            if not nodes:
                break
        return found

    def _followed(
        self, nodes: Sequence[_Node], seen: Sequence[_Seen], reached: list[set[int]]
    ) -> list[_Node]:
        """What follows nodes by what helps there, where their searches have not been.

        Args:
          nodes: of all searches.
          seen: what helps at each.
          reached: of each search the hashes of its states, which grow.
        """
        sampler = self._actions.sampler
        tried = [(place, each) for place, (_, helpful) in enumerate(seen) for each in helpful]
        found: list[_Node] = []
        most = max(1, MOST_VALUES // sampler.rows)
        for start in range(0, len(tried), most):
            part = tried[start : start + most]
            before = np.stack([nodes[place].state for place, _ in part], axis=1)
            legal = self._actions.legal(before, ((n, each) for n, (_, each) in enumerate(part)))
            if not legal:
                continue
            columns = [number for number, _ in legal]
            actions = self._actions.values([each for _, each in legal])
            uniform = np.full((sampler.draws, len(columns)), _LIKELY)
            stepped = sampler.step(before[:, columns], actions, uniform)
            codes = self._actions.codes(stepped.states).tolist()
            for column, (number, each) in enumerate(legal):
                node, code = nodes[part[number][0]], codes[column]
                own = reached[node.search]
                if code in own or len(own) >= _MOST_STATES:
                    continue
                own.add(code)
                state, ends = stepped.states[:, column], bool(stepped.ends[column])
                found.append(_Node(node.search, state, code, node.first or each, ends))
        return found

    def _look(self, nodes: Sequence[_Node], goals: Sequence[int], prices: Prices) -> list[_Seen]:
        """What the goals of their searches cost at nodes, and what helps there."""
        keys = [(node.code, goals[node.search], prices) for node in nodes]
        if len(self._known) > _REMEMBERED:
            self._known.clear()
        new = {key: node.state for key, node in zip(keys, nodes, strict=True)}
        new = {key: state for key, state in new.items() if key not in self._known}
        states = {code: state for (code, _, _), state in new.items()}
        wanted: dict[int, list[int]] = {}
        for code, goal, _ in new:
            wanted.setdefault(code, []).append(goal)
        codes, distances = list(states), self._distances
        most = max(1, MOST_VALUES // distances.rows)
        for start in range(0, len(codes), most):
            part = codes[start : start + most]
            costs = distances(np.stack([states[code] for code in part], axis=1), prices)
            to_goals = distances.to_goals(costs)
            for column, code in enumerate(part):
                ways = distances.ways(costs[:, column], states[code])
                for goal in wanted[code]:
                    helpful = ways.helpful(goal, all_ways=True)
                    self._known[code, goal, prices] = _Seen(
                        float(to_goals[goal, column]), tuple(dict.fromkeys(map(frozenset, helpful)))
                    )
        return [self._known[key] for key in keys]
