"""The first iteration of a training, which compiles it and tells how long a call may be."""

import time
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner

# a budget has at least so many calls, for a bound on the time can then be kept and a learning
# curve needs points
_CALLS_IN_A_BUDGET = 20
_CALLS_IN_A_RUN = 60
# whoever waits wants to see something move
_CALL_SECONDS = 1.0


def force_compilation(built: Built[MDPOPlanner], key: Any, budget: Budget) -> None:
    """Compiles the update and the test, and sees to it that a call does not take too long.

    Args:
      built: the planner and the arguments of its loop.
      key: JAX random key.
      budget: of the training; its seconds and iterations bound the length of a call.

    Raises:
      InputError: if JaxPlan cannot compile the problem with the planner's configuration.
    """
    planner = built.planner
    # no recompilation for another size, and no dashboard of its own
    generator = built.with_arguments(dashboard_id=None).callbacks(key, budget)
    with planner.call_sizes(1, 1):
        try:
            next(generator)
            started = time.perf_counter()
            if planner.in_calls:
                next(generator, None)
        except InputError:
            raise
        except Exception as error:  # whatever the problem and the values make JAX raise
            cause = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"JaxPlan cannot compile the planner: {cause}") from error
    generator.close()
    if planner.in_calls:
        seconds = time.perf_counter() - started
        longest = budget.seconds / _CALLS_IN_A_BUDGET
        planner.bound_calls(min(longest / seconds, budget.iterations / _CALLS_IN_A_RUN))
        # tests as often as on a faster machine, or the best iterate would be another one
        planner.bound_calls(max(_CALL_SECONDS / seconds, planner.test_every))
