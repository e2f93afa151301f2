"""One trial: the ordinary loop on the exact environment."""

from dataclasses import dataclass

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.ipc.planner import Planner
from mdpo_rddl.ipc.referee import ContestReferee, IllegalActionError
from mdpo_rddl.ipc.traces import Trace

OK = "ok"
ILLEGAL = "illegal"
ERROR = "error"
NON_FINITE = "non-finite"


@dataclass(frozen=True)
class Played:
    """How a trial went.

    Attributes:
      status: `OK`, `ILLEGAL` (an action that the rules or the environment refuse), `ERROR` (the
        planner or the environment raised an error) or `NON_FINITE` (a return without a value).
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
    referee, trace = ContestReferee(env), Trace()
    state, _ = env.reset(seed=seed)
    total, discount = 0.0, 1.0
    step = violations = 0
    status, cause = OK, ""
    done = env.done
    while not done:
        try:
            ruling = referee.rule(planner.act(step, state, rng))
            if ruling.is_violation:
                violations += 1
                if not lenient:
                    raise IllegalActionError("a precondition of the domain does not hold")
            following, reward, terminated, truncated, _ = env.step(ruling.actions)
        except IllegalActionError as error:
            status, cause = ILLEGAL, f"step {step}: {one_line_cause(error)}"
            break
        except Exception as error:  # whatever a planner raises fails the trial, not the run
            name = type(error).__name__
            status, cause = ERROR, f"step {step}: {name}: {one_line_cause(error)}"
            break
        trace.add(state, ruling.actions, float(reward))
        total += discount * float(reward)
        discount *= env.discount
        state, done = following, terminated or truncated
        step += 1
    if status == OK and not np.isfinite(total):
        status, cause = NON_FINITE, f"the return is {total}"
    return Played(status, cause, total, step, violations), trace
