"""Whether to think at all, and how: short paired trials while the policy is prepared."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.policy.lookahead.base import Method
from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.simulator import NARROW, Simulator
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.load import make_environment

State = Mapping[str, Any]

_TRIALS, _TEST_CALLS, _EPISODES = 10, 4, 2


@dataclass(frozen=True)
class Trial:
    """What a method gained at states that the base policy visits.

    Attributes:
      method: its name.
      mean: gain of a decision in rollouts that the decision did not see.
      error: the mean's standard error over the states.
    """

    method: str
    mean: float
    error: float

    @property
    def pays(self) -> bool:
        """Whether the gain is beyond its error."""
        return self.mean > self.error


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


def choose(
    policy: Policy, seconds: float, clock: Callable[[], float] = time.perf_counter
) -> Choice:
    """Prepares the methods that apply and takes the one that gains most, if any does.

    Each makes a few decisions at states that the policy visits. The gain of a decision is measured
    again on scenarios that it did not see. Ties go to the plain policy.

    Args:
      policy: the prepared policy.
      seconds: of a decision.
      clock: tells the seconds.
    """
    started = clock()
    reason = _unsuitable(policy)
    trials: list[Trial] = []
    best: tuple[float, LookaheadPolicy] | None = None
    if not reason:
        simulator = Simulator(policy, depth=1, clock=clock)
        applying = [method for method in _methods() if method.applies(simulator.components)]
        visited = _visited(policy) if applying else []
        reason = "" if applying else "no method changes such actions"
        if applying:
            simulator.prepare(visited[0][1], seconds)
        # the first one that applies sees all that the next would propose
        for method in applying[:1]:
            thinking = LookaheadPolicy(simulator, method, seconds, policy.seed, clock)
            trial = _try(thinking, simulator, visited)
            trials.append(trial)
            if trial.pays and (best is None or trial.mean > best[0]):
                best = trial.mean, thinking
    chosen = None if best is None else best[1]
    return Choice(chosen, trials, reason, clock() - started)


def _methods() -> list[Method]:
    return [FirstActions(), Coordinate()]


def _unsuitable(policy: Policy) -> str:
    """Why rollouts from the state at hand cannot be made; empty if they can."""
    if policy.planner.rddl.observ_fluents:
        return "the state is not observed"
    if policy.planner.plan.history_dependent:
        return "the policy reads the history"
    if policy.planner.preprocessor is not None:
        return "the policy reads preprocessed states"
    return ""


def _visited(policy: Policy) -> list[tuple[int, State]]:
    """Steps and states of a few episodes, as many as there are trials; the first is a start."""
    env = make_environment(policy.problem)
    found: list[tuple[int, State]] = []
    for episode in range(_EPISODES):
        state, step, done = env.reset(seed=policy.seed + episode)[0], 0, env.done
        while not done:
            found.append((step, state))
            state, _, terminated, truncated, _ = env.step(policy(step, state))
            step, done = step + 1, terminated or truncated
    if not found:
        return [(0, env.reset(seed=policy.seed)[0])]
    places = np.linspace(0, len(found) - 1, min(_TRIALS, len(found))).astype(int)
    return [found[place] for place in places]


def _try(
    thinking: LookaheadPolicy, simulator: Simulator, visited: Sequence[tuple[int, State]]
) -> Trial:
    gains = []
    for number, (step, state) in enumerate(visited):
        _, candidate, base = thinking.decide(step, state)
        if np.array_equal(candidate, base):
            gains.append(0.0)
            continue
        pair = np.stack([base, candidate])
        seeds = range(number * _TEST_CALLS, (number + 1) * _TEST_CALLS)
        fresh = [simulator.gains(NARROW, state, step, pair, seed) for seed in seeds]
        gains.append(float(np.mean(fresh)))
    thinking.decisions.clear()
    error = float(np.std(gains, ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else 0.0
    return Trial(thinking.method.name, float(np.mean(gains)), error)
