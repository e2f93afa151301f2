"""Two policies in the same episodes of the exact environment: which of them to play."""

from collections.abc import Callable, Sequence

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.problem.episode import Policy
from mdpo_rddl.problem.evaluation import LOST, evaluate, mean_and_error
from mdpo_rddl.problem.load import Problem, make_environment

FEWEST, MOST = 3, 40
"""Episodes that tell anything, and that are played at most."""
ERRORS = 0.5
"""A gain of so many errors is taken: the error of a few episodes hides gains worth having."""
# no more are played once the gain is so many errors
_CLEAR = 4.0
STREAM = 2**64
"""Added to a seed: a word more than seeds of evaluations have, so that none of their episodes is
drawn."""


def paired_returns(
    problem: Problem,
    policies: Sequence[Policy],
    until: float,
    clock: Callable[[], float],
    seed: int = 0,
    least: int = 20,
) -> np.ndarray:
    """What policies return in the same episodes [N, 2], as many as there is time for.

    They end early once the difference is clear, which a few episodes with the same luck may seem to
    make it. An episode counts as `Evaluation.worth`, or as `LOST` if the
    environment raises an error in it.

    Args:
      problem: what is played.
      policies: two, as `evaluate` plays them, in turn; or one, whose returns are [N, 1].
      until: no episode is begun that is likely to end later.
      clock: tells the seconds.
      seed: of the episodes, which are none that `evaluate` plays with a seed of a run.
      least: episodes before they may end early.
    """
    returns: list[list[float]] = []
    longest, before = 0.0, clock()
    env = make_environment(problem)
    while (
        len(returns) < MOST
        and before + longest <= until
        and not (len(returns) >= least and _is_clear(returns))
    ):
        episode = (STREAM + seed) * MOST + len(returns)
        returns.append([_return_of(policy, env, episode) for policy in policies])
        now = clock()
        longest, before = max(longest, now - before), now
    return np.array(returns).reshape(-1, len(policies))


def _return_of(policy: Policy, env: RDDLEnv, episode: int) -> float:
    try:
        return float(evaluate(env, policy, 1, episode).worth[0])
    except RDDLValueOutOfRangeError:
        return LOST


def _is_clear(returns: list[list[float]]) -> bool:
    if len(returns[0]) == 1:
        return False  # there is no difference
    mean, error = mean_and_error(np.array([first - second for first, second in returns]))
    return abs(mean) > _CLEAR * error
