"""Training to the end: a measurement has no use for half a run."""

from collections.abc import Mapping
from typing import Any

from mdpo_rddl.planner.config.budgets import A_DAY
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import TrainingResult, train


def train_fully(
    planner: MDPOPlanner,
    key: Any,
    iterations: int,
    optimize_args: Mapping[str, Any] | None = None,
) -> TrainingResult:
    """Trains for all iterations.

    Args:
      planner: the compiled planner.
      key: JAX random key.
      iterations: of training, whatever the configuration says.
      optimize_args: what the configuration has for `optimize`.

    Raises:
      KeyboardInterrupt: if interrupted, so that no row is made of what was found till then.
      InputError: if no finite return was found.
    """
    result = train(
        planner, key=key, iterations=iterations, seconds=A_DAY, optimize_kwargs=optimize_args
    )
    if result.status == "interrupted":
        raise KeyboardInterrupt
    return result
