"""Training to the end: a measurement has no use for half a run."""

from typing import Any

from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import A_DAY, Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training.training import TrainingResult, train


def train_fully(built: Built[MDPOPlanner], key: Any, iterations: int) -> TrainingResult:
    """Trains for all iterations.

    Args:
      built: the compiled planner.
      key: JAX random key.
      iterations: of training, whatever the configuration says.

    Raises:
      KeyboardInterrupt: if interrupted, so that no row is made of what was found till then.
      InputError: if no finite return was found.
    """
    result = train(built, key, Budget(iterations, A_DAY))
    if result.status == "interrupted":
        raise KeyboardInterrupt
    return result
