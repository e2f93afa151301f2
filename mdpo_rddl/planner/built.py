"""What is made of a problem and a configuration, ready to be trained."""

import dataclasses
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.upstream import JaxBackpropPlanner

AnyPlanner = TypeVar("AnyPlanner", bound=JaxBackpropPlanner, covariant=True)

_SILENT = {"print_summary": False, "print_progress": False, "print_hyperparams": False}
_GIVEN_APART = {"key", "epochs", "train_seconds", *_SILENT}


@dataclass(frozen=True)
class Built(Generic[AnyPlanner]):
    """A compiled planner with what its configuration says about training; it prints nothing.

    Attributes:
      planner: JaxPlan's, or ours.
      budget: where a training ends, unless somebody says otherwise.
      arguments: further arguments of `optimize`, without the key, the budget and what is printed.
    """

    planner: AnyPlanner
    budget: Budget = field(default_factory=Budget)
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        kept = {name: self.arguments[name] for name in self.arguments if name not in _GIVEN_APART}
        object.__setattr__(self, "arguments", kept)

    def with_arguments(self, **arguments: Any) -> "Built[AnyPlanner]":
        """The same planner with some further arguments of `optimize` set."""
        return dataclasses.replace(self, arguments={**self.arguments, **arguments})

    def training_arguments(self, budget: Budget | None = None) -> dict[str, Any]:
        """All keyword arguments of `optimize` but the key.

        Args:
          budget: where the training ends; as configured if None.
        """
        budget = budget or self.budget
        limits = {"epochs": budget.iterations, "train_seconds": budget.seconds}
        return {**self.arguments, **_SILENT, **limits}

    def callbacks(
        self, key: Any, budget: Budget | None = None
    ) -> Generator[dict[str, Any], None, None]:
        """JaxPlan's callbacks of a training, one for each turn of its loop.

        Args:
          key: JAX random key.
          budget: where the training ends; as configured if None.
        """
        return self.planner.optimize_generator(key=key, **self.training_arguments(budget))
