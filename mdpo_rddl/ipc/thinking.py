"""Our planner with time to think at each decision of a trial."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.ipc.mdpo import MDPO, race_seconds
from mdpo_rddl.policy.lookahead.choice import choice_share, choose, longest_choice
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.trials import NO_TIME
from mdpo_rddl.problem.grounding import require_observation, require_step
from mdpo_rddl.problem.load import Problem

# of a trial's time; the rest is the environment's, and a margin
_SHARE = 0.7
# no decision is planned to be longer; time that is saved may double it
_LONGEST_SECONDS, _BANKED = 1.0, 2.0
# shorter ones do not pay for their overhead
_SHORTEST_SECONDS = 0.01
_NOTHING_TRIED = "nothing was tried"


class ThinkingMDPO(MDPO):
    """As `MDPO`, and thinks at its decisions where trials have shown that it pays.

    A decision has its share of what is left of the trial's time, so that time saved at one is there
    for the next, and no trial runs out of it.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        """Knows no trial's time yet, without which it does not think."""
        super().__init__(clock=clock)
        self._trial_seconds, self._trial_began = 0.0, 0.0
        self._each_seconds: float | None = None
        self._begin()

    def _begin(self) -> None:
        """Nothing is known of a problem."""
        # when the last action was given, and the longest that the environment has taken after one
        self._acted, self._between = 0.0, 0.0
        self._thinker: LookaheadPolicy | None = None
        self._note = _NOTHING_TRIED

    @property
    def thinker(self) -> LookaheadPolicy | None:
        """What makes the decisions; None where the policy plays alone."""
        return self._thinker

    @property
    def note(self) -> str:
        """Why the policy plays alone; empty if it does not."""
        return self._note

    def decide_within(self, seconds: float) -> None:
        """Has each decision take so long, whatever a trial's time; is called before `prepare`."""
        self._each_seconds = seconds

    def play_within(self, seconds: float) -> None:
        """Is told the time of a trial."""
        self._trial_seconds = seconds

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Looks for a policy, and in a part of the time for whether to think."""
        self._begin()
        decision, kept = self._decision_of(problem), 0.0
        if decision >= _SHORTEST_SECONDS:
            kept = min(choice_share(problem) * race_seconds(seconds), longest_choice(decision))
        super().prepare(problem, seconds - kept, seed)

    def restore(self, problem: Problem, folder: Path) -> None:
        """Reads the policy, which plays alone until it is improved."""
        self._begin()
        super().restore(problem, folder)

    def improve(self, seconds: float) -> None:
        """Tries whether to think, and how, now that the policy is kept."""
        policy, decision = self._policy, self._decision_seconds
        if decision < _SHORTEST_SECONDS or seconds <= 0.0:
            self._note = NO_TIME
            return
        within = min(longest_choice(decision), race_seconds(seconds))
        choice = choose(policy, decision, within, self._clock)
        self._thinker, self._note = choice.policy, choice.note

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """The better one of the policy's action and those that a look ahead has found."""
        if self._thinker is None:
            return super().act(step, state, rng)
        now = self._clock()
        require_step(self._policy.problem.model, step)
        require_observation(self._policy.problem.model, state)
        if step == 0:
            self._trial_began = now
            self._thinker.begin()
        else:
            self._between = max(self._between, now - self._acted)
        action = self._thinker.decide(step, state, self._seconds_at(step, now))[0]
        legal = self._moves.rule(action, state).actions
        self._thinker.was_played(legal)
        self._acted = self._clock()
        return legal

    def act_alone(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """As `MDPO.act`: what the prepared policy does without thinking."""
        return super().act(step, state, rng)

    def _seconds_at(self, step: int, now: float) -> float:
        """For the decision at a step."""
        if self._each_seconds is not None:
            return self._each_seconds
        left = _SHARE * self._trial_seconds - (now - self._trial_began)
        share = left / (self._policy.problem.horizon - step) - self._between
        return min(max(0.0, share), _BANKED * self._decision_seconds)

    @property
    def _decision_seconds(self) -> float:
        """What a decision is prepared for."""
        return self._decision_of(self._policy.problem)

    def _decision_of(self, problem: Problem) -> float:
        if self._each_seconds is not None:
            return self._each_seconds
        return min(_SHARE * self._trial_seconds / problem.horizon, _LONGEST_SECONDS)
