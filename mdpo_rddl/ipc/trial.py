"""One trial: an episode under the competition's rules."""

from dataclasses import dataclass

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.ipc.planner import Planner
from mdpo_rddl.ipc.referee import ContestReferee, IllegalActionError, ViolationError
from mdpo_rddl.ipc.traces import Trace
from mdpo_rddl.problem.episode import Episode

OK = "ok"
ILLEGAL = "illegal"
ERROR = "error"
NON_FINITE = "non-finite"

MOST_RETURN = 1e150
"""Larger returns have squares that are not finite, and no interval."""


@dataclass(frozen=True)
class Played:
    """How a trial went.

    Attributes:
      status: `OK`, `ILLEGAL` (an action that the rules or the environment refuse), `ERROR` (the
        planner or the environment raised an error) or `NON_FINITE` (a return that is not finite or
        above `MOST_RETURN`).
      cause: one line; empty if `OK`.
      total: discounted return up to the end.
      steps: number of steps; below the horizon where a termination condition ended the trial.
      violations: actions that broke a precondition.
    """

    status: str
    cause: str
    total: float
    steps: int
    violations: int


def play(
    env: RDDLEnv, planner: Planner, seed: int, rng: np.random.Generator, lenient: bool
) -> tuple[Played, Trace]:
    """Plays one trial.

    Args:
      env: a vectorized environment that does not enforce preconditions itself.
      planner: prepared for its problem.
      seed: of the environment.
      rng: the planner's random numbers.
      lenient: whether to go on after a broken precondition.
    """
    trace = Trace()
    episode = Episode(
        env=env,
        policy=lambda step, state: planner.act(step, state, rng),
        referee=ContestReferee(env, lenient),
        recorder=trace,
    )
    state, _ = env.reset(seed=seed)
    status, cause, violations = OK, "", 0
    try:
        episode.play(state)
    except IllegalActionError as error:
        violations += isinstance(error, ViolationError)
        status, cause = ILLEGAL, f"step {episode.steps}: {one_line_cause(error)}"
    except Exception as error:  # whatever a planner raises fails the trial, not the run
        name = type(error).__name__
        status, cause = ERROR, f"step {episode.steps}: {name}: {one_line_cause(error)}"
    if status == OK and not abs(episode.total) <= MOST_RETURN:
        status, cause = NON_FINITE, f"the return is {episode.total}"
    violations += episode.illegal
    return Played(status, cause, episode.total, episode.steps, violations), trace
