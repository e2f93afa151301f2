"""Training to the end: a measurement has no use for half a run."""

from typing import Any

from mdpo_rddl.budgets import A_DAY
from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.training import TrainingResult, train


def train_fully(planner: MDPOPlanner, key: Any, iterations: int) -> TrainingResult:
    """Trains for all iterations.

    Raises:
      KeyboardInterrupt: if interrupted, so that no row is made of what was found till then.
      InputError: if no finite return was found.
    """
    result = train(planner, key=key, iterations=iterations, seconds=A_DAY)
    if result.status == "interrupted":
        raise KeyboardInterrupt
    return result
