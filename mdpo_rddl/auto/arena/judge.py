"""Which candidate is the best, by rollouts on the exact model that are the same for all."""

import dataclasses
import logging
import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.auto.common.compilations import TooLateError, compiled_within
from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.timing import Clock, Timed
from mdpo_rddl.planner.exact.exact import exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.problem.evaluation import LOST, mean_and_error
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

ROLLOUTS = 128
"""Of a candidate, where time and memory reach."""


# where an error that is rare in play must be seen
_ROLLOUTS_TELLING_ERRORS = 1024


def rollouts_for(problem: Problem) -> int:
    """How many rollouts of a candidate are wanted."""
    return _ROLLOUTS_TELLING_ERRORS if problem.raises else ROLLOUTS


def _ignore(judged: Judged) -> None:
    del judged


# with fewer rollouts the best of many candidates would be the luckiest
_MANY_ROLLOUTS = 32


class MeanReturn:
    """Mean return of single policies and its standard error, on the exact model."""

    def __init__(self, planner: MDPOPlanner, rollouts: int, seed: int) -> None:
        """Compiles nothing yet.

        Args:
          planner: whose policies are played.
          rollouts: of each policy.
          seed: of the rollouts; searches and training draw other numbers from the same one.
        """
        self._returns = exact_returns(planner, rollouts)
        self._key = key_for(Draws.JUDGE, seed)

    def __call__(self, params: Any) -> tuple[float, float]:
        """Plays the policy with these parameters."""
        return mean_and_error(self.returns(params))

    def returns(self, params: Any) -> np.ndarray:
        """The return of each rollout [N]."""
        one = jax.tree.map(lambda leaf: np.asarray(leaf)[np.newaxis], params)
        return np.asarray(self._returns(self._key, one), float)[0]


def difference_error(one: Candidate, other: Candidate) -> float:
    """Standard error of the difference of two means, rollout by rollout where both were played.

    Rollouts that one of them has lost are left out: how many these are decides by itself.
    """
    if one.returns is not None and other.returns is not None:
        are_whole = (one.returns > LOST) & (other.returns > LOST)
        if np.any(~are_whole) and np.count_nonzero(are_whole) < 2:
            return 0.0
        differences = (one.returns - other.returns)[are_whole]
        if np.all(np.isfinite(differences)):
            return mean_and_error(differences)[1]
    return float(np.hypot(one.error, other.error))


class Judge:
    """Plays candidates and remembers the best.

    Attributes:
      rollouts: of each candidate.
      incumbent: the best candidate so far, with its mean and error; None before the first.
      judged: all candidates, in the order in which they came; one that leads later on, as another
        has turned out to return less, comes once more.
      program_seconds: about what the first planner's rollouts take to compile, if that is known;
        it does not begin where less time is left: nothing ends a compilation that came too late.
    """

    def __init__(
        self,
        rollouts: int,
        seed: int,
        clock: Clock,
        began: float,
        on_judged: Callable[[Judged], None] = _ignore,
        deadline: float = math.inf,
    ) -> None:
        """Compiles nothing yet.

        Args:
          rollouts: of each candidate.
          seed: of the rollouts, which no search sees.
          clock: what dates the candidates.
          began: when the race began, by the clock.
          on_judged: called with each candidate once it is judged.
          deadline: until when compilation is waited for, by the clock.
        """
        self._on_judged, self.program_seconds = on_judged, 0.0
        self.rollouts, self._seed = rollouts, seed
        self._clock, self._began, self._deadline = clock, began, deadline
        self._players: list[tuple[MDPOPlanner, Timed[[Any], np.ndarray]]] = []
        self.incumbent: Candidate | None = None
        self.judged: list[Judged] = []

    @property
    def best_mean(self) -> float:
        """Mean return of the incumbent; minus infinity before the first."""
        return -np.inf if self.incumbent is None else self.incumbent.known_mean

    @property
    def compile_seconds(self) -> float:
        """Of the rollouts of all planners so far."""
        return sum(play.compile_seconds for _, play in self._players)

    @property
    def usual_seconds(self) -> float:
        """What it took to compile the rollouts of the first planner; 0 before that."""
        return self._players[0][1].compile_seconds if self._players else 0.0

    @property
    def rollout_seconds(self) -> float:
        """What the first planner's rollouts of one candidate took lately; 0 before any."""
        return self._players[0][1].seconds if self._players else 0.0

    @property
    def one_rollout_seconds(self) -> float:
        """The same of one of these rollouts; 0 if only those were played that compiled."""
        if not self._players or self._players[0][1].calls < 2:
            return 0.0
        return self.rollout_seconds / self.rollouts

    def record(self, candidate: Candidate) -> bool:
        """Plays a candidate unless its return is known; whether it is the new incumbent.

        A mean that is not finite is worst. A candidate of the incumbent's planner, or of the arm of
        one without a planner, must be better; with few rollouts, or if it is of another planner,
        whose rollouts need not meet the same random numbers, it must be so by a standard error of
        the difference, which is taken rollout by rollout where both were played.

        Args:
          candidate: with a planner, or with its mean and error, and the returns if there are any.

        Raises:
          TooLateError: if what plays its planner's candidates is not compiled by the deadline.
        """
        mean, error, returns = candidate.mean, candidate.error, candidate.returns
        if mean is None:
            returns = self.returns_of(candidate)
            with np.errstate(invalid="ignore"):
                mean, error = mean_and_error(returns)
        mean, error = (mean, error) if np.isfinite(mean) else (-np.inf, 0.0)
        candidate = dataclasses.replace(candidate, mean=mean, error=error, returns=returns)
        best = self.incumbent
        is_better = best is None or mean > best.known_mean + _margin(candidate, best)
        logger.info("%s: %.6g", candidate.label, mean)
        self._tell(candidate, is_better)
        return is_better

    def is_ready(self, candidate: Candidate) -> bool:
        """Whether a candidate can be judged without compiling anything."""
        played = [planner for planner, play in self._players if play.calls]
        return candidate.mean is not None or any(one is candidate.planner for one in played)

    def lead(self, candidate: Candidate) -> None:
        """Makes another candidate the incumbent that was judged before, and was not better then."""
        self._tell(candidate, became_incumbent=True)

    def _tell(self, candidate: Candidate, became_incumbent: bool) -> None:
        self.judged.append(Judged(candidate, self._clock() - self._began, became_incumbent))
        if became_incumbent:
            self.incumbent = candidate
        self._on_judged(self.judged[-1])

    def correct(self, candidate: Candidate, returns: np.ndarray) -> None:
        """Replaces what probing has said of a candidate, which has no standard error.

        The best of many constants may have been lucky there; others that return more would have to
        exceed that. One whose error or returns are known stays as it is. Where the incumbent loses
        its lead, the best of all that were judged has it. Who leads then is told once more.

        Args:
          candidate: that was judged.
          returns: of rollouts of the exact model [N].
        """
        mean, error = mean_and_error(returns)
        is_known = candidate.returns is not None or candidate.error > 0.0
        if is_known or not (np.isfinite(mean) and np.isfinite(error)):
            return
        known = dataclasses.replace(candidate, mean=mean, error=error)
        self.judged = [
            dataclasses.replace(one, candidate=known) if one.candidate is candidate else one
            for one in self.judged
        ]
        if self.incumbent is candidate:
            found = [one.candidate for one in self.judged]
            self.incumbent = max(found, key=lambda each: (each.known_mean, each is known))
            if self.incumbent is known:
                self._on_judged(Judged(known, self._clock() - self._began, True))
            else:
                self.lead(self.incumbent)

    def best_of(self, planner: MDPOPlanner) -> Candidate | None:
        """The best candidate of one planner, the first of equals; None if there is none."""
        own = [j.candidate for j in self.judged if j.candidate.planner is planner]
        return max(own, key=lambda candidate: candidate.known_mean, default=None)

    def best_of_arm(self, arm: str) -> Candidate | None:
        """The best candidate of an arm that has parameters; None if there is none."""
        own = [j.candidate for j in self.judged if j.candidate.arm == arm]
        own = [candidate for candidate in own if candidate.params is not None]
        return max(own, key=lambda candidate: candidate.known_mean, default=None)

    def became_incumbent(self, label: str) -> bool:
        """Whether a candidate of that label was ever the best so far."""
        return any(j.became_incumbent for j in self.judged if j.candidate.label == label)

    def latest(self, label: str) -> Candidate | None:
        """The latest candidate of that label, whatever it was worth."""
        of_label = (j.candidate for j in reversed(self.judged) if j.candidate.label == label)
        return next(of_label, None)

    def returns_of(self, candidate: Candidate) -> np.ndarray:
        """Returns [N] of a candidate, which is not judged by this.

        Raises:
          TooLateError: as `record`.
        """
        planner = candidate.planner
        if planner is None:
            raise ValueError(f"{candidate.label}: there is no planner to play it")
        for known, play in self._players:
            if known is planner:
                return play(candidate.params)
        left = self._deadline - self._clock()
        if not self._players and self.program_seconds > left:
            raise TooLateError("too little time is left to compile the rollouts of policies")
        mean = compiled_within(left, lambda: MeanReturn(planner, self.rollouts, self._seed))
        play = Timed(mean.returns, self._clock, self._deadline)
        self._players.append((planner, play))
        return play(candidate.params)


def _margin(candidate: Candidate, best: Candidate) -> float:
    """What a candidate's mean must exceed the incumbent's by."""
    # what another process has left has no planner here, or is a table
    if best.planner is None and candidate.arm == best.arm:
        return 0.0
    is_other = candidate.planner is not best.planner or best.planner is None
    are_few = candidate.returns is not None and len(candidate.returns) < _MANY_ROLLOUTS
    return difference_error(candidate, best) if is_other or are_few else 0.0
