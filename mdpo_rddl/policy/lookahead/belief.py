"""A prepared policy of a partially observed problem, with its belief of the state."""

import copy
import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.exact.continuations import HiddenRoot
from mdpo_rddl.planner.exact.filtering import Filtered, ParticleFilter, Particles
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.rollouts.plan_memory import Entries
from mdpo_rddl.policy.lookahead.base import ByPlans, Prepared, Tabled, Vote
from mdpo_rddl.policy.playable import decision_key, step_keys
from mdpo_rddl.policy.recall import Recall
from mdpo_rddl.problem.episode import tell_played
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.observation import is_observed

# particles, and the fewest where the time of a decision does not allow so many
_PARTICLES, _FEWEST = 2048, 256
# of the time of a decision, the filter may take, and one that a vote has: fewer particles would be
# another vote than the one that is played without thinking
_SHARE, _VOTE_SHARE = 0.1, 0.5
# where no particle matches, others are drawn so often, as long as there is that time
_ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class Belief(Mapping[str, Any]):
    """What a player knows at a step; it reads as what is observed there.

    Attributes:
      observed: as the environment shows it.
      root: where rollouts begin, with the policy's memory before the step.
      matches: whether any particle could have led to the observation.
      deciding: of other particles, in which a decision at this belief begins, so that it can be
        measured from the root, which it did not see; None if the decision begins in the root.
    """

    observed: Mapping[str, Any]
    root: HiddenRoot
    matches: bool
    deciding: HiddenRoot | None = None

    def __getitem__(self, name: str) -> Any:
        """What is observed of a fluent."""
        return self.observed[name]

    def __iter__(self) -> Iterator[str]:
        """The observation fluents."""
        return iter(self.observed)

    def __len__(self) -> int:
        """How many there are."""
        return len(self.observed)


@dataclass
class Believer:
    """Follows one episode after the other; plays as the policy does.

    Attributes:
      policy: the prepared policy, with a memory or without one.
      clock: tells the seconds.
      particles: that the filter has, or fewer once `prepare` has seen how long it takes.
      attempts_seconds: where no particle matches, others are drawn as long as there is that time.
      filter: that gives the particles; the exact model's if None.
      continuing: what plays in compiled rollouts, where that is not the policy.
      filter_seconds: that a step of the filter takes, once it is prepared.
    """

    policy: Prepared
    clock: Callable[[], float] = time.perf_counter
    particles: int = _PARTICLES
    attempts_seconds: float = 0.0
    filter: ParticleFilter | None = None
    continuing: Prepared | None = field(default=None, init=False)
    filter_seconds: float = field(default=0.0, init=False)
    _now: Belief | None = field(default=None, init=False)
    _step: int = field(default=-1, init=False)
    _before: list[Particles] = field(default_factory=list, init=False)
    # what was played last, and what was played before the latest step
    _action: Mapping[str, Any] = field(init=False)
    _led: Mapping[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        """Compiles nothing yet."""
        planner = self.policy.planner
        self._filter = ParticleFilter(planner) if self.filter is None else self.filter
        self._keys = step_keys(planner, self.policy.seed)
        self._recall = Recall(planner)
        self._action, self._led = self._noop(), self._noop()

    @property
    def now(self) -> Belief | None:
        """The latest belief of the episode that is followed."""
        return self._now

    @property
    def problem(self) -> Problem:
        """What is played."""
        return self.policy.problem

    @property
    def planner(self) -> MDPOPlanner:
        """Its models."""
        return self.policy.planner

    @property
    def rollout_policy(self) -> Callable[..., Any]:
        """What plays in compiled rollouts."""
        return self._continuing.rollout_policy

    @property
    def params(self) -> Any:
        """Of what plays in compiled rollouts."""
        return self._continuing.params

    @property
    def policy_hyperparams(self) -> Mapping[str, Any]:
        """JaxPlan's, which go with the parameters."""
        return self._continuing.policy_hyperparams

    @property
    def underlying(self) -> Prepared | Tabled | ByPlans | None:
        """The policy's of the underlying MDP, if it has one."""
        return self.policy.underlying

    @property
    def vote(self) -> Vote | None:
        """The policy's."""
        return self.policy.vote

    @property
    def _continuing(self) -> Prepared:
        return self.policy if self.continuing is None else self.continuing

    @property
    def seed(self) -> int:
        """Of whatever is drawn."""
        return self.policy.seed

    def save(self, path: str | Path) -> None:
        """Writes the policy to a file."""
        self.policy.save(path)

    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The policy's action at a step.

        Args:
          step: number of decisions before.
          observation: a belief of `believe`'s, whose memory of the episode counts.
        """
        known, memory = dict(observation), dict[str, Any]()
        if isinstance(observation, Belief):
            if (vote := self.policy.vote) is not None:
                return vote.elect(step, observation.root.particles)
            # of the same types at each step, so that nothing is compiled twice
            known, memory = dict(observation.root.observed), dict(observation.root.memory)
        own = self.policy
        key = decision_key(self.planner.rddl, self._keys[step], known)
        given = key, own.params, step, known, own.policy_hyperparams
        return self.planner.get_action(*given, *([memory] if memory else []))

    def continued_by(self, policy: Prepared) -> "Believer":
        """The same, with nothing compiled again, but for what plays in compiled rollouts.

        Args:
          policy: of the underlying MDP, which reads the state.
        """
        other = self.anew()
        other.continuing = policy
        return other

    def anew(self) -> "Believer":
        """The same for episodes of its own, with nothing compiled again."""
        other = copy.copy(self)
        other._now, other._step, other._before = None, -1, []
        other._recall = Recall(self.planner)
        return other

    def prepare(self, seconds: float, until: float = math.inf) -> None:
        """Compiles the filter, once more with fewer particles if it takes too long.

        Args:
          seconds: of a decision.
          until: a second compilation that is likely to end later, as long as the first one, is not
            begun.
        """
        observed = self._shown(dict.fromkeys(self.planner.rddl.observ_fluents))
        began = self.clock()
        self.filter_seconds = self._measured(observed)
        now = self.clock()
        is_in_time = now + (now - began) <= until
        share = _SHARE if self.filter is None else _VOTE_SHARE
        count = max(_FEWEST, int(self.particles * share * seconds / self.filter_seconds))
        if is_in_time and count < self.particles:
            self.particles = count
            self.filter_seconds = self._measured(observed)
        self.attempts_seconds = _SHARE * seconds

    def believe(self, step: int, observation: Mapping[str, Any], is_tried: bool = False) -> Belief:
        """The belief at a step, and at the first one the initial state.

        A step that is asked for again is the same decision again. One that does not follow the last
        begins anew: nothing is known of what has led to it.

        Args:
          step: number of decisions before.
          observation: what the environment has shown, or a belief, which is given back as a
            decision sees it.
          is_tried: whether a second filter gives the particles of the decision.
        """
        if isinstance(observation, Belief):
            root = observation.deciding or observation.root
            return dataclasses.replace(observation, root=root, deciding=None)
        memory: Entries = jax.tree.map(lambda leaf: leaf[0], self._recall.at(step, 1))
        shown, last = self._shown(observation), self._now
        if last is None or step == 0 or step not in (self._step, self._step + 1):
            self._before, self._action, self._led = [], self._noop(), self._noop()
        elif step == self._step + 1:
            before, self._led = (last.root, last.deciding), self._action
            self._before = [dict(root.particles) for root in before if root is not None]
        self._step = step
        found = [self._filtered(number, shown) for number in range(1 + is_tried)]
        roots = [HiddenRoot(each.particles, shown, memory) for each in found]
        self._now = Belief(observation, roots[0], bool(found[0].matches), *roots[1:])
        return self._now

    def played(self, belief: Mapping[str, Any], action: Mapping[str, Any]) -> None:
        """Takes in what was played, if it was at the latest belief of the episode.

        Args:
          belief: for which the action was chosen.
          action: per action fluent [*shape].
        """
        if belief is not self._now or self._now is None:
            return
        seen = {name: np.asarray(v)[np.newaxis] for name, v in self._now.root.observed.items()}
        numbers = {name: self.planner.numbers(name, value) for name, value in action.items()}
        self._recall.note(seen, {name: value[np.newaxis] for name, value in numbers.items()})
        self._action = numbers

    def _filtered(self, number: int, seen: Mapping[str, Any]) -> Filtered:
        """What the first or the second filter makes of what was seen."""
        if not self._before:
            count = self.particles
            return Filtered(self._filter.start(count), np.float64(count), np.bool_(True))
        # a second filter may begin later than the first, with its particles
        before = self._before[min(number, len(self._before) - 1)]
        until = self.clock() + self.attempts_seconds
        key = jax.random.fold_in(jax.random.PRNGKey(self.seed), 2 * self._step + number)
        for attempt in range(_ATTEMPTS):
            began = self.clock()
            draw = jax.random.fold_in(key, attempt)
            found = self._filter.advance(draw, before, self._led, seen)
            matches, now = bool(found.matches), self.clock()
            if matches or now + (now - began) > until:
                break
        return found

    def _measured(self, seen: Mapping[str, Any]) -> float:
        """Seconds of the filter once it is compiled."""
        took, action = 0.0, self._noop()
        for attempt in range(2):
            began = self.clock()
            key = jax.random.PRNGKey(attempt)
            particles = self._filter.start(self.particles)
            jax.block_until_ready(self._filter.advance(key, particles, action, seen))
            took = self.clock() - began
        return took

    def _shown(self, observation: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """What is seen as numbers of the model's types, and initial values before step 1."""
        known, shown = self.planner.test_compiled.init_values, {}
        for name in self.planner.rddl.observ_fluents:
            value, like = observation[name], np.asarray(known[name])
            if is_observed(value):
                numbers = self.planner.numbers(name, value)
                like = np.reshape(numbers, like.shape).astype(like.dtype)
            shown[name] = like
        return shown

    def _noop(self) -> dict[str, np.ndarray]:
        known = self.planner.test_compiled.init_values
        return {name: np.asarray(known[name]) for name in self.planner.rddl.action_fluents}


def believing(
    policy: Prepared, seconds: float, until: float, clock: Callable[[], float]
) -> Prepared:
    """The policy, prepared to follow its episodes where the state is not observed.

    One that votes has compiled a filter and what its particles elect, which are used again.

    Args:
      policy: the prepared one.
      seconds: of a decision.
      until: no second compilation of a filter is begun that is likely to end later.
      clock: tells the seconds.
    """
    if not policy.planner.rddl.observ_fluents:
        return policy
    vote, believer = policy.vote, Believer(policy, clock)
    if vote is not None:
        believer = Believer(policy, clock, vote.particles, filter=vote.filter)
    believer.prepare(seconds, until)
    return believer


def known_at(
    policy: Prepared, step: int, observation: Mapping[str, Any], is_tried: bool = False
) -> Mapping[str, Any]:
    """What rollouts from a step begin with: the state, or a belief where it is not observed.

    Args:
      policy: the prepared one.
      step: number of decisions before.
      observation: what the environment has shown, or a belief.
      is_tried: whether a decision at a belief is to be measured from particles it does not see.
    """
    if isinstance(policy, Believer):
        return policy.believe(step, observation, is_tried)
    return observation


def is_unmatched(known: Mapping[str, Any]) -> bool:
    """Whether no particle of a belief could have led to what was observed."""
    return isinstance(known, Belief) and not known.matches


def note_played(policy: Prepared, known: Mapping[str, Any], action: Mapping[str, Any]) -> None:
    """Tells whoever follows the episode what was played."""
    if isinstance(policy, Believer):
        policy.played(known, action)
    else:
        tell_played(policy, action)
