"""Who leads: candidates, judged by the same episodes."""

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np

from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.evaluation import LOST, mean_and_error
from mdpo_rddl.race.arm import Candidate, Context, Judged
from mdpo_rddl.race.budget import Budget, DeadlineError
from mdpo_rddl.race.evaluator import CONFIRMATION
from mdpo_rddl.race.outcome import Point

# episodes by which a candidate may take the lead, and by which the result is confirmed
_MOST, _CONFIRMED = 128, 1024
# standard errors of a difference by which fewer episodes decide
_ERRORS = 3.0
# candidates of different arms that the confirmation compares
_RIVALS = 4


class Board:
    """All candidates so far, and the best of them.

    Attributes:
      points: in the order in which they were judged.
      leader: the best candidate; None before the first.
      feedback: the best whose policy is one of the race's family; None before the first.
    """

    def __init__(self, context: Context, on_judged: Callable[[Point], None]) -> None:
        """Has judged nothing yet."""
        self._context, self._on_judged = context, on_judged
        self.points: list[Point] = []
        self.leader: Judged | None = None
        self.feedback: Judged | None = None
        self._best: dict[str, Judged] = {}

    def judge(self, candidate: Candidate) -> Judged:
        """Plays a candidate until it is clear whether it leads, or for enough episodes.

        Ties go to whoever led before, but a proven optimum leads at once.

        Raises:
          DeadlineError: if the race's time is over before; the first candidate leads in any case.
        """
        play, returns = candidate.policy.replicated(), candidate.returns
        if not len(returns):
            try:
                returns = self._context.evaluator.more(play, returns, self._context.on_iteration)
            except DeadlineError:
                if self.leader is not None:
                    raise
                returns = np.full(1, -np.inf)
        judged, leads = Judged(candidate, returns), True
        if not is_proven(judged):
            judged, leads = self._compared(judged, play)
        self.points.append(Point(candidate, judged.returns, self._context.budget.used, leads))
        if leads:
            self.leader = judged
        best = self._best.get(candidate.arm)
        if best is None or leads or judged.mean > best.mean:
            self._best[candidate.arm] = judged
        if self._is_of_family(candidate.policy):
            is_best = self.feedback is None or judged.mean > self.feedback.mean
            self.feedback = judged if leads or is_best else self.feedback
        self._on_judged(self.points[-1])
        return judged

    def best_return(self, arm: str) -> float | None:
        """Mean return of an arm's best candidate."""
        best = self._best.get(arm)
        return None if best is None else best.mean

    def confirm(self, budget: Budget) -> Judged:
        """The best of the leading arms' candidates in episodes that none of them was chosen by.

        Episodes are doubled while there is time, at most to a thousand. The leader stays where
        another one is not better by a standard error of the difference, or where it is proven.

        Args:
          budget: for it.
        """
        assert self.leader is not None
        rivals = sorted(self._best.values(), key=lambda each: -each.mean)
        rivals = [each for each in rivals if each.candidate is not self.leader.candidate]
        rivals = [] if is_proven(self.leader) else rivals
        chosen = [self.leader, *rivals[: _RIVALS - 1]]
        plays = [each.candidate.policy.replicated() for each in chosen]
        found = [np.zeros(0) for _ in chosen]
        evaluator = self._context.evaluator
        with contextlib.suppress(DeadlineError):
            while len(found[0]) < _CONFIRMED:
                found = [
                    evaluator.more(play, returns, budget.check, CONFIRMATION)
                    for play, returns in zip(plays, found, strict=True)
                ]
                if self._context.certain:
                    break
        if not len(found[0]):
            return self.leader
        best = 0
        for number in range(1, len(chosen)):
            gain, error = _difference(found[number], found[best])
            if gain > error and np.isfinite(gain):
                best = number
        return Judged(chosen[best].candidate, found[best])

    def _compared(self, judged: Judged, play: Any) -> tuple[Judged, bool]:
        """A candidate with all of its returns, and whether it is better than the leader."""
        leader, context = self.leader, self._context
        if leader is None:
            return judged, True
        rival = leader.candidate.policy.replicated()
        while True:
            count = len(judged.returns)
            while len(leader.returns) < count:
                more = context.evaluator.more(rival, leader.returns, self._context.on_iteration)
                leader = self.leader = leader._replace(returns=more)
            gain, error = _difference(judged.returns, leader.returns[:count])
            is_same = gain == 0.0 and error == 0.0
            is_clear = is_same or context.certain or not abs(gain) <= _ERRORS * error
            if is_clear or count >= _MOST:
                return judged, bool(gain > 0.0)
            judged = judged._replace(
                returns=context.evaluator.more(play, judged.returns, self._context.on_iteration)
            )

    def _is_of_family(self, policy: Any) -> bool:
        is_formula = isinstance(policy, Policy) and not policy.votes
        return is_formula and policy.config is self._context.family.config


def is_proven(judged: Judged | None) -> bool:
    """Whether a candidate is the best that there can be."""
    return judged is not None and getattr(judged.candidate.policy, "optimum", None) is not None


def _difference(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """The mean of what one returns more than another [N], and its standard error.

    The error is that of episodes which both have played to their end: how many one has lost decides
    by itself.
    """
    whole = (one > LOST) & (other > LOST)
    with np.errstate(invalid="ignore"):
        gain = float(np.mean(one - other))
        error = mean_and_error((one - other)[whole])[1] if whole.sum() > 1 else 0.0
    return gain, error
