"""Decisions by relaxed plans, for many states side by side.

A state's promise is what its goals are worth, less for each step that the delete relaxation says
they are away. Of the actions on the cheapest ways to the most promising goals, alone and together,
those are played after which most is promised: greedy best-first search with the helpful actions of
FF (Hoffmann and Nebel 2001) at each decision anew, as FF-Replan does (Yoon, Fern and Givan,
"FF-Replan: a baseline for probabilistic planning", 2007), with the model's chances in the costs.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mdpo_rddl.policy.ground_actions import MOST_VALUES, NOTHING, GroundActions, Proposal
from mdpo_rddl.policy.hill_climbing import HillClimbing
from mdpo_rddl.policy.plan_rule import PlanRule
from mdpo_rddl.problem.delete_relaxation.circuit import Assignment
from mdpo_rddl.problem.delete_relaxation.distances import FAR, Distances, Prices
from mdpo_rddl.problem.delete_relaxation.relaxed import relaxed
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import OpenModel

# proposals of a state, the goals that they are for, and of how many of these together
_MOST_PROPOSALS, _MOST_GOALS, _MOST_TOGETHER = 32, 64, 3
# by which a proposal must promise more
_ROUNDING = 1e-6


class _Decision(NamedTuple):
    """What the decisions of one step have in common: steps left, the rule, random numbers."""

    left: int
    rule: PlanRule
    uniform: np.ndarray


class RelaxedPlans:
    """Decides by the relaxation of a ground model.

    Attributes:
      model: the ground model, with the action left open.
      actions: what can be played in it.
      sampler: of it.
      noop: values of all action variables of the no-op [A].
    """

    def __init__(self, model: OpenModel, limits: EnumerationLimits) -> None:
        """Makes the relaxation.

        Args:
          model: whose graph grows.
          limits: for the time.

        Raises:
          NotEnumerableError: if that is not understood, becomes too large, or has no goal.
        """
        self.actions = GroundActions(model)
        self.model, self.sampler, self.noop = model, self.actions.sampler, self.actions.noop
        self._distances = Distances(relaxed(model, limits), model.horizon)
        self._climbing = HillClimbing(self._distances, self.actions)

    def uniform(self, seed: int, step: int, rule: PlanRule) -> np.ndarray:
        """The random numbers of a decision [draws, samples]: the same for all states."""
        generator = np.random.default_rng([seed, step])
        samples = rule.samples if self.sampler.is_random else 1
        return generator.random((self.sampler.draws, samples))

    def reach_something(self, states: np.ndarray) -> np.ndarray:
        """Of states [V, N], whether some goal is a step or more away, and in reach [N]."""
        distances = self._distances
        costs = distances.to_goals(distances(states, Prices()))
        return np.any((costs >= Prices().step) & (costs < FAR), axis=0)

    def decide(
        self, states: np.ndarray, step: int, rule: PlanRule, uniform: np.ndarray
    ) -> np.ndarray:
        """The actions in states of one step.

        Args:
          states: values of all state variables [V, N].
          step: number of decisions before.
          rule: what else decides.
          uniform: see `uniform`.

        Returns:
          Values of all action variables [A, N]; where none are better, the defaults.
        """
        left, count = self.model.horizon - step, states.shape[1]
        given = _Decision(left, rule, uniform)
        costs = self._distances(states, rule.prices)
        to_goals = self._distances.to_goals(costs)
        promised = self._promised(to_goals, left, rule)
        # what is held needs no action, and would hide the others
        open_ = np.where(self._is_held(to_goals), 0.0, promised)
        proposals = self._proposals(states, costs, open_)
        chosen, best = self._waiting(states, given)
        active, grown = list(range(count)), [NOTHING] * count
        if rule.searches:
            for place, proposal in self._climbed(states, open_, given, best):
                grown[place] = chosen[place] = proposal
        for _ in range(self.actions.most):
            joined = [
                (each, proposal)
                for each in active
                # in place of what takes the no-op's, and beside it, as it may have to be done
                for begun in dict.fromkeys((grown[each], chosen[each]))
                for proposal in dict.fromkeys(begun | more for more in proposals[each])
                if proposal not in (grown[each], chosen[each]) and self.actions.fits(proposal)
            ]
            joined = self.actions.legal(states, joined)
            active = self._improve(states, joined, given, chosen, best)
            if not active:
                break
            for place in active:
                grown[place] = chosen[place]
        return self.actions.values(chosen)

    def _climbed(
        self, states: np.ndarray, promised: np.ndarray, given: _Decision, best: np.ndarray
    ) -> list[tuple[int, Proposal]]:
        """First steps to where goals are nearer, where none is a step away; writes their worth.

        Args:
          states: values of all state variables [V, N].
          promised: what each goal that is not held promises [G, N].
          given: what the decisions have in common.
          best: what is played is worth [N].
        """
        found = self._climbing.first_steps(states, promised, given.left - 1, given.rule.prices)
        if found:
            places = np.array([place for place, _ in found])
            best[places] = self._worth(states[:, places], [each for _, each in found], given)
        return found

    def _waiting(self, states: np.ndarray, given: _Decision) -> tuple[list[Proposal], np.ndarray]:
        """What is done in each state if nothing helps, and what it is worth to the patient [N].

        That is the no-op; where it is illegal, the best of what takes its place.
        """
        chosen = [NOTHING] * states.shape[1]
        best = self._worth(states, chosen, given, given.rule.patience)
        is_legal = self.sampler.legal(states, self.actions.values(chosen))
        best[~is_legal] = -np.inf
        places = np.flatnonzero(~is_legal).tolist()
        others = self.actions.legal(
            states, ((place, each) for place in places for each in self._simplest)
        )
        self._improve(states, others, given, chosen, best, given.rule.patience)
        return chosen, best

    def _improve(
        self,
        states: np.ndarray,
        proposals: Sequence[tuple[int, Proposal]],
        given: _Decision,
        chosen: list[Proposal],
        best: np.ndarray,
        patience: float = 1.0,
    ) -> list[int]:
        """Writes the better of proposals over those of their states; the states where some are.

        Args:
          states: values of all state variables [V, N].
          proposals: legal ones, with the number of the state that each is for.
          given: what the decisions have in common.
          chosen: of each state the best so far.
          best: what that is worth [N].
          patience: see `PlanRule`.
        """
        if not proposals:
            return []
        places = np.array([place for place, _ in proposals])
        worth = self._worth(states[:, places], [each for _, each in proposals], given, patience)
        better = set()
        for (place, proposal), value in zip(proposals, worth, strict=True):
            if value > best[place] + self._margin(best[place]):
                best[place], chosen[place] = value, proposal
                better.add(place)
        return sorted(better)

    @staticmethod
    def _margin(worth: float) -> float:
        """What another proposal must be better by."""
        return _ROUNDING * (1.0 + abs(worth)) if np.isfinite(worth) else 0.0

    @cached_property
    def _simplest(self) -> list[Proposal]:
        """Each value of each action alone, and of each fluent that is a bool all that may change.

        They are for states in which the no-op is illegal.
        """
        single = [
            frozenset([(number, value)])
            for number, values in enumerate(self.actions.others)
            for value in range(len(values))
        ]
        together: dict[str, set[tuple[int, int]]] = {}
        for number, (name, _) in enumerate(self.model.actions):
            if len(self.actions.others[number]) == 1:
                together.setdefault(name, set()).add((number, 0))
        return single + [
            whole for each in together.values() if self.actions.fits(whole := frozenset(each))
        ]

    def _proposals(
        self, states: np.ndarray, costs: np.ndarray, promised: np.ndarray
    ) -> list[list[Proposal]]:
        """What is on the ways to the most promising goals: each alone, and all that go together.

        The latter are cut to what is legal together.
        """
        found: list[dict[Proposal, None]] = [{} for _ in range(states.shape[1])]
        together: list[tuple[int, Sequence[Assignment]]] = []
        for place, own in enumerate(found):
            ways = self._distances.ways(costs[:, place], states[:, place])
            # what the way to one goal has shown is not looked at again for another one
            seen = set[int]()
            goals = np.argsort(-promised[:, place], kind="stable")[:_MOST_GOALS].tolist()
            for number, goal in enumerate(goals):
                if promised[goal, place] <= 0.0 or len(own) >= _MOST_PROPOSALS:
                    break
                helpful = ways.helpful(goal, all_ways=True, seen=seen)
                helpful = helpful[: _MOST_PROPOSALS - len(own)]
                own |= dict.fromkeys(map(frozenset, helpful))
                if number < _MOST_TOGETHER:
                    together.append((place, ways.helpful(goal, all_ways=False)))
        for place, proposal in self.actions.joint(states, together):
            found[place][proposal] = None
        return [list(own) for own in found]

    def _worth(
        self,
        states: np.ndarray,
        proposals: Sequence[Proposal],
        given: _Decision,
        patience: float = 1.0,
    ) -> np.ndarray:
        """The reward of proposals [N] and what is promised after it, a mean over the samples."""
        # of a large problem many at once would take gigabytes
        rows = self._distances.rows + self.sampler.rows
        most = max(1, MOST_VALUES // (rows * given.uniform.shape[1]))
        parts = [slice(start, start + most) for start in range(0, len(proposals), most)]
        worth = [
            self._worth_of_few(states[:, part], proposals[part], given, patience) for part in parts
        ]
        return np.concatenate(worth)

    def _worth_of_few(
        self,
        states: np.ndarray,
        proposals: Sequence[Proposal],
        given: _Decision,
        patience: float,
    ) -> np.ndarray:
        left, rule, uniform = given
        samples = uniform.shape[1]
        repeated = np.repeat(states, samples, axis=1)
        actions = np.repeat(self.actions.values(proposals), samples, axis=1)
        drawn = np.tile(uniform, (1, len(proposals)))
        stepped = self.sampler.step(repeated, actions, drawn)
        # many are the same state
        _, first, places = np.unique(
            self.actions.codes(stepped.states), return_index=True, return_inverse=True
        )
        distances = self._distances
        costs = distances.to_goals(distances(stepped.states[:, first], rule.prices))
        promise = self._promise(costs, left - 1, rule)[places.ravel()]
        promise = np.where(stepped.ends, 0.0, promise)
        worth = stepped.rewards + self.model.discount * patience * promise
        return worth.reshape(len(proposals), samples).mean(axis=1)

    def _promised(self, costs: np.ndarray, left: int, rule: PlanRule) -> np.ndarray:
        """What each goal promises [G, N], so many steps before the end."""
        distances, step = self._distances, rule.prices.step
        # what stands for chance in the costs takes no time
        steps = np.maximum(left - costs / step, 1.0)
        paid = np.where(distances.lasts[:, np.newaxis], steps, 1.0)
        worth = distances.worths[:, np.newaxis] * paid * np.exp(-costs - step)
        return np.where((costs < FAR) & (left > 0), worth, 0.0)

    def _is_held(self, costs: np.ndarray) -> np.ndarray:
        """Which goals pay at one step after another as it is [G, N]."""
        return self._distances.lasts[:, np.newaxis] & (costs <= 0.0)

    def _promise(self, costs: np.ndarray, left: int, rule: PlanRule) -> np.ndarray:
        """What states promise [N]: all that lasts and is reached, and the best of what is not.

        Where goals add up, a state between two of them is as good as one on the way to either.
        """
        promised = self._promised(costs, left, rule)
        is_held = self._is_held(costs)
        held, open_ = np.where(is_held, promised, 0.0), np.where(is_held, 0.0, promised)
        best = open_.max(axis=0)
        return held.sum(axis=0) + best + rule.others * (open_.sum(axis=0) - best)
