"""Whether to think at all, and how: short paired trials while the policy is prepared."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.policy.lookahead.base import Method, Prepared
from mdpo_rddl.policy.lookahead.belief import believing, known_at, note_played
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.residuals import Residuals
from mdpo_rddl.policy.lookahead.simulator import NARROW, Simulator
from mdpo_rddl.problem.load import make_environment

State = Mapping[str, Any]

_TRIALS, _TEST_CALLS, _EPISODES = 10, 4, 2
# gains at fewer states say nothing
_FEWEST_TRIALS = 3
# where compilation took longer than expected, each method may have so much of the time all the same
_BEYOND = 0.1
NO_TIME = "no time"
# the programs and the trials of all methods take at most so many seconds and decisions
_COMPILE_SECONDS, _DECISIONS = 20.0, 40
# a gain must be so many standard errors: the best of several methods is taken
_ERRORS = 2.0
# of the time for the choice, the episodes that give the states may take
_VISITING_SHARE = 0.25
# the fractional parts of its multiples are spread evenly
_GOLDEN = 0.618033988749895


@dataclass(frozen=True)
class Trial:
    """What a method gained at states that the base policy visits.

    Attributes:
      method: its name.
      mean: gain of a decision in rollouts that the decision did not see; None without a result.
      error: the mean's standard error over the states; None without a result.
      note: why there is no result; empty if there is one.
    """

    method: str
    mean: float | None
    error: float | None
    note: str = ""

    @property
    def pays(self) -> bool:
        """Whether the gain is beyond two standard errors."""
        if self.mean is None or self.error is None:
            return False
        return self.mean > _ERRORS * self.error


@dataclass(frozen=True, eq=False)
class Choice:
    """How to play.

    Attributes:
      policy: that thinks; None if the plain policy is to be played.
      trials: of each method that was tried.
      reason: why no method was tried; empty if some were.
      seconds: that the choice took, compilation included.
    """

    policy: LookaheadPolicy | None
    trials: Sequence[Trial]
    reason: str
    seconds: float

    @property
    def note(self) -> str:
        """Why the plain policy is played; empty if it is not."""
        if self.policy is not None:
            return ""
        short = self.trials and all(trial.note == NO_TIME for trial in self.trials)
        return self.reason or (NO_TIME if short else "no gain")


def longest_choice(seconds: float) -> float:
    """Seconds that the choice may take where nothing else limits it.

    Args:
      seconds: of a decision.
    """
    return _COMPILE_SECONDS + _DECISIONS * seconds


def choose(
    policy: Prepared,
    seconds: float,
    within: float = math.inf,
    clock: Callable[[], float] = time.perf_counter,
) -> Choice:
    """Prepares the methods that apply and takes the one that gains most, if any does.

    Each makes a few decisions at states that the policy visits. The gain of a decision is measured
    again on scenarios that it did not see. Ties go to the plain policy.

    Args:
      policy: the prepared policy.
      seconds: of a decision.
      within: seconds for the choice, shared by the methods. The first compilation tells how long
        others take; none is begun that would end later. A decision that has begun goes on to its
        end; a method for which no time is left may go a tenth beyond.
      clock: tells the seconds.
    """
    started = clock()
    reason = _unsuitable(policy)
    trials: list[Trial] = []
    best: tuple[float, LookaheadPolicy] | None = None
    if not reason:
        components = Components.of(policy.planner)
        applying = [method for method in _methods() if method.applies(components)]
        reason = "" if applying else "no method changes such actions"
        if applying:
            policy = believing(policy, seconds, clock)
            now = clock()
            visited = _visited(policy, lambda: clock() < now + _VISITING_SHARE * within)
            simulator = Simulator(policy, max(method.depth for method in applying), clock)
            until = started + within
            if not simulator.prepare(visited[0][1], seconds, until):
                trials = [Trial(method.name, None, None, NO_TIME) for method in applying]
                applying = []
            elif any(method.climbs for method in applying):
                simulator.prepare_climbing(visited[0][1], until)
        for number, method in enumerate(applying):
            now = clock()
            share = (started + within - now) / (len(applying) - number)
            few = 2 * _FEWEST_TRIALS * seconds
            until = now + max(share, min(few, _BEYOND * within))
            thinking = LookaheadPolicy(simulator, method, seconds, policy.seed, clock)
            trial = _Tried(thinking, simulator, clock).at(visited, until)
            trials.append(trial)
            if trial.mean is not None and trial.pays and (best is None or trial.mean > best[0]):
                best = trial.mean, thinking
    chosen = None if best is None else best[1]
    return Choice(chosen, trials, reason, clock() - started)


def _methods() -> list[Method]:
    return [FirstActions(), Coordinate(), Residuals()]


def _unsuitable(policy: Prepared) -> str:
    """Why rollouts from the state at hand cannot be made; empty if they can."""
    if policy.planner.memory.initial and not policy.planner.rddl.observ_fluents:
        return "the policy remembers"
    if policy.planner.plan.history_dependent:
        return "the policy reads the history"
    if policy.planner.preprocessor is not None:
        return "the policy reads preprocessed states"
    return ""


def _visited(policy: Prepared, has_time: Callable[[], bool]) -> list[tuple[int, State]]:
    """Steps and states, or beliefs, of a few episodes, as many as there are trials.

    The first is a start; the others are in an order in which the first few are far apart.

    Args:
      policy: plays.
      has_time: whether to play on.
    """
    env = make_environment(policy.problem)
    found: list[tuple[int, State]] = []
    for episode in range(_EPISODES):
        state, step, done = env.reset(seed=policy.seed + episode)[0], 0, env.done
        while not done and (has_time() or not found):
            known = known_at(policy, step, state, is_tried=True)
            found.append((step, known))
            action = policy(step, known)
            note_played(policy, known, action)
            state, _, terminated, truncated, _ = env.step(action)
            step, done = step + 1, terminated or truncated
    if not found:
        return [(0, known_at(policy, 0, env.reset(seed=policy.seed)[0]))]
    places = np.linspace(0, len(found) - 1, min(_TRIALS, len(found))).astype(int)
    order = np.argsort(np.arange(len(places)) * _GOLDEN % 1.0)
    return [found[place] for place in places[order]]


@dataclass
class _Tried:
    """Decisions of one method and what they gained.

    Attributes:
      thinking: makes the decisions.
      simulator: measures them again.
      clock: tells the seconds.
    """

    thinking: LookaheadPolicy
    simulator: Simulator
    clock: Callable[[], float]

    def at(self, visited: Sequence[tuple[int, State]], until: float) -> Trial:
        """Decides at the states in turn, until the time is over."""
        gains, name, longest = list[float](), self.thinking.method.name, 0.0
        self.thinking.method.reset()
        for number, (step, state) in enumerate(visited):
            before = self.clock()
            if before + longest > until:
                break
            gains.append(self._gain(number, step, state))
            longest = max(longest, self.clock() - before)
        decisions, enough = self.thinking.decisions, min(_FEWEST_TRIALS, len(visited))
        has_played = any(decision.calls for decision in decisions)
        decisions.clear()
        if len(gains) < enough or not has_played:
            return Trial(name, None, None, NO_TIME)
        error = float(np.std(gains, ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else 0.0
        return Trial(name, float(np.mean(gains)), error)

    def _gain(self, number: int, step: int, state: State) -> float:
        """What the decision at a state is worth on scenarios that it did not see."""
        _, candidate, base = self.thinking.decide(step, state)
        if np.array_equal(candidate, base):
            return 0.0
        pair = np.stack([base, candidate])
        seeds = range(number * _TEST_CALLS, (number + 1) * _TEST_CALLS)
        fresh = [self.simulator.gains(NARROW, state, step, pair, seed) for seed in seeds]
        return float(np.mean(fresh))
