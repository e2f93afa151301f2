"""What a training may take, and what holds where nobody has said it."""

from dataclasses import dataclass

JAXPLAN_EPOCHS = 999999
JAXPLAN_SECONDS = 120.0
JAXPLAN_BATCH = 32
"""JaxPlan's own defaults: iterations and seconds of a training, rollouts of an iteration."""

AUTO_SECONDS = 90.0
"""The preset `auto`, for everything before the evaluation."""

DECISION_SECONDS = 1.0
"""For each decision of a plan that is made online."""

A_DAY = 86400.0
"""Seconds for a training that only its iterations are to end."""


@dataclass(frozen=True)
class Budget:
    """Where a training ends at the latest.

    Attributes:
      iterations: their largest number.
      seconds: the largest time.
    """

    iterations: int = JAXPLAN_EPOCHS
    seconds: float = JAXPLAN_SECONDS
