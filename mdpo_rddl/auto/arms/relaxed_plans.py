"""The arm that tries rules by which relaxed plans are made into decisions."""

import contextlib
import logging
import math
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace

import numpy as np

from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.relaxed_plans import RelaxedPlans
from mdpo_rddl.problem.delete_relaxation.distances import Prices
from mdpo_rddl.problem.delete_relaxation.relaxed import changes_integers
from mdpo_rddl.problem.enumeration.limits import (
    EnumerationLimits,
    NotEnumerableError,
    OutOfTimeError,
)
from mdpo_rddl.problem.enumeration.model import OpenModel
from mdpo_rddl.problem.evaluation import mean_and_error

logger = logging.getLogger(__name__)

RELAXED_PLANS = "relaxed plans"
# that are tried, the most different ones first
_RULES = (
    PlanRule(),
    PlanRule(prices=Prices(tries=True), searches=True),
    PlanRule(prices=Prices(0.97)),
    PlanRule(others=0.2),
)
# that return no more than the no-op, after which it is given up
_PATIENCE = 2
# side by side, for each rule: as many as take so much of the first slice and of the race, by what
# two take; twice as many take 1.5 times as long
_EPISODES, _FEWEST_EPISODES, _GROWTH = (16, 8, 4), 2, 0.6
_RULE_SHARE, _RULE_RACE_SHARE = 0.25, 0.05
# of what may follow a decision, where they would take longer
_FEW_SAMPLES = 2
# of the best rule, other ones that tell what it returns: at most so many times as many; where as
# many take such a share of the race, until the error is so small a share of what is gained over
# the no-op; the fewest then
_FRESH, _LONG_SHARE, _CLEAR, _FEWEST_FRESH = 8, 0.01, 0.02, 8
# by which a state is looked for in which a reward is steps away
_NOOP_EPISODES = 8
# makes random numbers of episodes none of those of decisions
_STREAM = 1
# of a slice: where the relaxation takes longer, so do its decisions; what both take then at least
_MAKING_SHARE, _MUCH_LONGER = 0.5, 2.5


class _IllegalActionError(NotEnumerableError):
    """What is played breaks a precondition."""


class RelaxedPlansArm(Arm):
    """Offers the best of a few rules, with its return in simulated episodes.

    It is offered when candidates are taken, not before: what is first said of a rule is noisy, and
    the judge would go by the largest return that was ever told of it.
    """

    def __init__(
        self,
        config: PlannerConfig,
        seed: int,
        clock: Clock,
        model: OpenModel,
        pulse: Callable[[], None] = lambda: None,
    ) -> None:
        """Does nothing yet.

        Args:
          config: of the race.
          seed: of everything that is drawn.
          clock: what is asked for the time.
          model: of the problem, with the action left open.
          pulse: called between two steps of the episodes.
        """
        super().__init__(RELAXED_PLANS, clock)
        self._config, self._seed, self._model, self._pulse = config, seed, model, pulse
        self._plans: RelaxedPlans | None = None
        # what the fewest episodes of a rule take
        self._few_seconds = 0.0
        self._steps: Iterator[None] | None = None
        # returns of the rules, and in the same episodes of the no-op, under None, if it is legal
        self._returns: dict[PlanRule | None, np.ndarray] = {}
        # the best rule, once all were tried, and its returns in other episodes
        self._fresh: tuple[PlanRule, list[np.ndarray]] | None = None
        # episodes that the latest offer was told by
        self._offered: tuple[PlanRule, int] | None = None

    @property
    def is_untried(self) -> bool:
        """Whether no rule was played yet, for which there may have been too little time."""
        return self._tried_rules == 0 and not self.is_exhausted

    @property
    def misses_numbers(self) -> bool:
        """Whether actions change integers, which cost nothing in a relaxed plan."""
        return changes_integers(self._model)

    @property
    def is_undecided(self) -> bool:
        """Whether too few rules were tried to tell whether plans are of any use."""
        return self._tried_rules < _PATIENCE and not self.is_exhausted

    @property
    def _tried_rules(self) -> int:
        return sum(rule is not None for rule in self._returns)

    @property
    def leading(self) -> float:
        """Mean return of the best rule so far; minus infinity if it is no more than the no-op's."""
        known = self._known
        return -math.inf if known is None else float(np.mean(known[1]))

    def take_candidates(self) -> list[Candidate]:
        """The best rule so far, if more is known of it than the last time."""
        self._offer_best()
        return super().take_candidates()

    @property
    def _known(self) -> tuple[PlanRule, np.ndarray] | None:
        """The best rule so far and its returns, in fresh episodes if there are any."""
        if self._fresh is not None:
            return self._fresh[0], np.concatenate(self._fresh[1])
        best = self._best
        return None if best is None else (best, self._returns[best])

    @property
    def _best(self) -> PlanRule | None:
        """The rule that returns most; None if that is no more than the no-op."""
        return max(
            self._returns, key=lambda rule: float(np.mean(self._returns[rule])), default=None
        )

    def _work(self, until: float) -> None:
        try:
            self._try_rules(until)
        except NotEnumerableError as error:
            self._give_up(str(error))
        except Exception as error:  # the other arms need no plans
            self._give_up(f"{type(error).__name__}: {one_line_cause(error)}")

    def _try_rules(self, until: float) -> None:
        began = self._clock()
        if self._lacks_time(until):
            return  # a longer slice may come
        try:
            self._steps = self._steps or self._begin(until)
        except OutOfTimeError:
            self._few_seconds = _MUCH_LONGER * (until - began)
        if self._lacks_time(until):
            return
        self._log.details = {}
        assert self._steps is not None
        for _ in self._steps:
            self._pulse()
            if self._clock() >= until:
                return
        self.is_exhausted = True

    def _lacks_time(self, until: float) -> bool:
        """Whether a first rule could not be played till then."""
        is_long = self.is_untried and self._few_seconds > until - self._clock()
        if is_long:
            self._log.details = {"cause": f"a rule's episodes take {self._few_seconds:.0f} s"}
        return is_long

    def _begin(self, until: float) -> Iterator[None]:
        """The relaxation; the steps of all episodes that are to be played."""
        seconds = max(0.0, until - self._clock())
        limits = EnumerationLimits(_MAKING_SHARE * seconds, clock=self._clock)
        plans = self._plans = RelaxedPlans(self._model, limits)
        few = np.repeat(self._timing_state(plans, limits), _FEWEST_EPISODES, axis=1)
        self._seconds_of(plans, few, _RULES[0])  # what is done once is done now
        self._few_seconds = self._seconds_of(plans, few, _RULES[0])
        rules: Sequence[PlanRule] = _RULES
        if self._few_seconds > _RULE_SHARE * seconds and plans.sampler.is_random:
            rules = [replace(rule, samples=_FEW_SAMPLES) for rule in _RULES]
            self._few_seconds = self._seconds_of(plans, few, rules[0])
        for_rule = min(_RULE_SHARE * seconds, _RULE_RACE_SHARE * self._config.budget().seconds)
        fitting = (n for n in _EPISODES if self._seconds_of_many(n) <= for_rule)
        starts = np.repeat(self._first, next(fitting, _FEWEST_EPISODES), axis=1)
        return self._tried(plans, starts, rules)

    def _timing_state(self, plans: RelaxedPlans, limits: EnumerationLimits) -> np.ndarray:
        """A state [V, 1] in which a reward is steps away: the initial one, if it is one there.

        Elsewhere what must be reached comes up by chance: it is the middle one of those in a few
        episodes of the no-op.

        Args:
          plans: of the problem.
          limits: for the time.

        Raises:
          NotEnumerableError: if there is none.
          OutOfTimeError: if it is not found in time.
        """
        model, sampler, states = self._model, plans.sampler, self._first
        if plans.reach_something(states).any():
            return states
        found = list[np.ndarray]()
        generator = np.random.default_rng([self._seed, 0, _STREAM])
        states = np.repeat(states, _NOOP_EPISODES, axis=1)
        # in the last state but one there is no time left to reach anything
        for _ in range(model.horizon - 2):
            self._pulse()
            limits.check_time()
            actions = np.repeat(plans.noop[:, np.newaxis], states.shape[1], axis=1)
            is_legal = sampler.legal(states, actions)
            drawn = generator.random((sampler.draws, states.shape[1]))
            stepped = sampler.step(states, actions, drawn)
            states = stepped.states[:, is_legal & ~stepped.ends]
            if not states.size:
                break
            found += [state[:, np.newaxis] for state in states[:, plans.reach_something(states)].T]
        if not found:
            raise NotEnumerableError("no reward that is a step or more away")
        return found[len(found) // 2]

    @property
    def _first(self) -> np.ndarray:
        """The initial state [V, 1]."""
        return np.array([int(value) for value in self._model.first])[:, np.newaxis]

    def _seconds_of_many(self, count: int) -> float:
        """What so many episodes of a rule take, by what the fewest do."""
        return self._few_seconds * (count / _FEWEST_EPISODES) ** _GROWTH

    def _take_long(self, count: int) -> bool:
        """Whether so many episodes of a rule take a share of the race that matters."""
        return self._seconds_of_many(count) > _LONG_SHARE * self._config.budget().seconds

    def _seconds_of(self, plans: RelaxedPlans, states: np.ndarray, rule: PlanRule) -> float:
        """What episodes take that begin in states [V, N], by one decision."""
        started = self._clock()
        plans.decide(states, 0, rule, plans.uniform(self._seed, 0, rule))
        return self._model.horizon * max(self._clock() - started, 1e-9)

    def _tried(
        self, plans: RelaxedPlans, starts: np.ndarray, rules: Sequence[PlanRule]
    ) -> Iterator[None]:
        """Plays the no-op and the rules, and the best rule in other episodes."""
        with contextlib.suppress(_IllegalActionError):
            yield from self._played(plans, starts, None)
        # where episodes are few, what they return is told before other rules are tried
        rules = rules if starts.shape[1] > _FEWEST_EPISODES else rules[:_PATIENCE]
        for number, rule in enumerate(rules, start=1):
            yield from self._played(plans, starts, rule)
            self._log.iterations = number
            if number >= _PATIENCE and self._best is None:
                raise NotEnumerableError("its plans return no more than the no-op")
        best, returns = self._best, list[np.ndarray]()
        assert best is not None
        few_are_enough = self._take_long(starts.shape[1])
        for stream in range(1, _FRESH + 1):
            returns.append((yield from self._episodes(plans, starts, best, stream)))
            # those that it was chosen by were kind to it
            self._fresh = best, returns
            if few_are_enough and self._is_clear(np.concatenate(returns)):
                break

    def _is_clear(self, returns: np.ndarray) -> bool:
        """Whether it is clear what the best rule gains over the no-op, by its returns [N]."""
        noop = self._returns.get(None)
        if noop is None or len(returns) < _FEWEST_FRESH:
            return False
        mean, error = mean_and_error(returns)
        noop_mean, noop_error = mean_and_error(noop)
        # that a few are equal may be chance
        is_told = error > 0.0 or len(returns) >= 2 * _FEWEST_FRESH
        return is_told and error <= _CLEAR * (mean - noop_mean - noop_error)

    def _played(
        self, plans: RelaxedPlans, starts: np.ndarray, rule: PlanRule | None
    ) -> Iterator[None]:
        self._returns[rule] = yield from self._episodes(plans, starts, rule, 0)

    def _episodes(
        self, plans: RelaxedPlans, starts: np.ndarray, rule: PlanRule | None, stream: int
    ) -> Generator[None, None, np.ndarray]:
        """Episodes side by side: their returns, after a pause at each step.

        Args:
          plans: of the problem.
          starts: initial states [V, N].
          rule: that decides; the no-op is played if it is None.
          stream: of random numbers.

        Raises:
          _IllegalActionError: where an action is illegal, so that the environment would play
            another one.
        """
        model, sampler, states = self._model, plans.sampler, starts
        count = starts.shape[1]
        generator = np.random.default_rng([self._seed, stream, _STREAM])
        total, alive = np.zeros(count), np.ones(count, bool)
        for step in range(model.horizon):
            if rule is None:
                actions = np.repeat(plans.noop[:, np.newaxis], count, axis=1)
            else:
                actions = plans.decide(states, step, rule, plans.uniform(self._seed, step, rule))
            if not sampler.legal(states[:, alive], actions[:, alive]).all():
                raise _IllegalActionError("no legal action was found in a state")
            stepped = sampler.step(states, actions, generator.random((sampler.draws, count)))
            # after the end a reward may be no number
            total += np.where(alive, stepped.rewards * model.discount**step, 0.0)
            alive &= ~stepped.ends
            states = stepped.states
            yield
            if not alive.any():
                break
        return total

    def _offer_best(self) -> None:
        """Offers the best rule so far, unless there is none or no more is known of it."""
        if (known := self._known) is None:
            return
        best, returns = known
        if self._offered == (best, len(returns)):
            return
        self._offered = best, len(returns)
        mean, error = mean_and_error(returns)
        self._offer(
            Candidate(
                arm=self.name,
                label=RELAXED_PLANS,
                config=self._config,
                planner=None,
                params=None,
                plans=(best, Simulated(mean, error, len(returns))),
                relaxed=self._plans,
                mean=mean,
                error=error,
            )
        )

    def _give_up(self, cause: str) -> None:
        logger.info("no relaxed plans: %s", cause)
        self._log.details = {**self._log.details, "cause": cause}
        self.is_exhausted = True
