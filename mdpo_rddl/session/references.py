"""The no-op and random actions, which a policy is compared with: many episodes on the simulator."""

import time
from collections.abc import Callable

import numpy as np

from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.problem.trajectories import Trajectories, TrajectoriesRecorder
from mdpo_rddl.session.requests import EvaluationTerms
from mdpo_rddl.simulator.evaluation import (
    NoopReplicas,
    RandomReplicas,
    SideBySide,
    evaluate_side_by_side,
)
from mdpo_rddl.simulator.simulator import Simulator

MOST_EPISODES = 1_000
"""Of one policy."""

_FIRST, _TIMES = 16, 8
# a few that took longer are all, since the report is waited for; so many more take hardly longer
# where the interpreter takes most of the time, and as many times as long at most
_SECONDS = 0.12


def many_episodes(play: Callable[[int], SideBySide], most: int = MOST_EPISODES) -> SideBySide:
    """Plays a few episodes, and then more as long as these take no time to speak of.

    Args:
      play: plays so many.
      most: that are played.
    """
    count = min(_FIRST, most)
    while True:
        began = time.perf_counter()
        found = play(count)
        if count == most or time.perf_counter() - began > _SECONDS:
            return found
        count = min(_TIMES * count, most)


def noop_evaluation(
    simulator: Simulator, terms: EvaluationTerms, recorder: TrajectoriesRecorder
) -> tuple[Evaluation, Trajectories]:
    """Plays the no-op.

    Args:
      simulator: of the problem.
      terms: of the policy's evaluation.
      recorder: of the problem; says how many episodes are kept at most.

    Raises:
      NotPlayedError: if the environment would have raised an error in an episode.
    """
    policy = NoopReplicas()
    found = many_episodes(
        lambda count: evaluate_side_by_side(simulator, policy, count, terms.seed, keep=True),
        recorder.kept,
    )
    return found.evaluation, recorded(found, recorder)


def random_evaluation(simulator: Simulator, terms: EvaluationTerms) -> Evaluation:
    """Plays random legal actions, as `noop_evaluation`."""

    def play(count: int) -> SideBySide:
        policy = RandomReplicas(simulator, np.random.default_rng(terms.seed))
        return evaluate_side_by_side(simulator, policy, count, terms.seed)

    return many_episodes(play).evaluation


def recorded(found: SideBySide, recorder: TrajectoriesRecorder) -> Trajectories:
    """Episodes whose trajectories were kept, as the recorder keeps them."""
    kept = found.trajectories
    assert kept is not None
    return recorder.of_replicas(kept.states, kept.actions, kept.rewards, found.evaluation.lengths)
