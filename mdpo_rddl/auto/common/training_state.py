"""A training as a part of an arm's state."""

import dataclasses
import math
from typing import Any

import numpy as np

from mdpo_rddl.auto.common.candidate import has_structure
from mdpo_rddl.auto.common.state import State
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training.checkpoints import Checkpoints, TrainingState
from mdpo_rddl.policy.trees import flatten, unflatten


@dataclasses.dataclass(frozen=True, eq=False)
class BestIterate:
    """The best iterate of a training.

    Attributes:
      params, policy_hyperparams: of the policy.
      mean_return: by the training itself.
    """

    params: Any
    policy_hyperparams: Any
    mean_return: float

    def state(self) -> State:
        """All of it."""
        trees = {"params": self.params, "hyperparams": dict(self.policy_hyperparams)}
        return State(flatten(trees, "best"), {"mean_return": self.mean_return})

    @classmethod
    def of(cls, state: State, planner: MDPOPlanner) -> "BestIterate":
        """What `state` has made a state of, if it is a policy of the planner's.

        Raises:
          KeyError, TypeError, ValueError: if it is none.
        """
        trees = unflatten(state.tensors)["best"]
        hyperparams = trees.get("hyperparams", {})
        mean = float(state.values["mean_return"])
        if not has_structure(planner, trees["params"], hyperparams) or not math.isfinite(mean):
            raise ValueError("its best iterate is none of the planner's")
        return cls(trees["params"], hyperparams, mean)


def state_of(training: TrainingState) -> State:
    """A training's state as an arm's."""
    return State(training.tensors, dict(training.numbers))


def checkpoints_of(state: State | None = None) -> Checkpoints:
    """For a training whose state an arm asks for, and that goes on with an earlier one if given.

    Raises:
      KeyError, TypeError, ValueError: if that is none.
    """
    if state is None:
        return Checkpoints(math.inf, None)
    resumed = TrainingState(
        {name: np.array(tensor) for name, tensor in state.tensors.items()}, dict(state.values)
    )
    if resumed.iterations < 1 or not resumed.seconds >= 0.0:
        raise ValueError("its numbers are not those of a training")
    return Checkpoints(math.inf, None, resumed)
