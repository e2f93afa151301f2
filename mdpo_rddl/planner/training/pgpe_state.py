"""What JaxPlan's loop carries for PGPE beside the gradient, seen and put back from outside.

PGPE's parameters, its optimiser's state and its largest return pass through its own two functions;
which of its policies replace the gradient's depends on the smallest test loss so far, and its
entropy's weight on the share of the budget that is used: local variables of the loop both.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.upstream import planner as jaxplan

_TREES = ("pgpe_params", "pgpe_opt_state", "r_max")
TREES = tuple(f"pgpe/{name}" for name in _TREES)


class WatchedPGPE(jaxplan.PGPE):
    """In place of a planner's PGPE while its loop runs.

    Attributes:
      best_losses: the smallest smoothed test loss so far, one of each lane.
    """

    def __init__(
        self,
        trained: MDPOPlanner,
        carried: dict[str, Any],
        resumed_losses: np.ndarray | None,
        tree: Callable[[str, Any], Any],
        progress: Callable[[], float],
    ) -> None:
        """Watches nothing yet.

        Args:
          trained: the planner, with a PGPE.
          carried: where the state of an iteration is left; has the policies' `params` and
            `train_loss` before PGPE's turn.
          resumed_losses: the smallest losses that the loop goes on with; it begins anew if None.
          tree: (name, template) -> the saved tree, for a loop that goes on.
          progress: percent of the budget used, for a loop that goes on.
        """
        super().__init__()
        self._pgpe, self._merge, self._carried = trained.pgpe, trained.merge_pgpe, carried
        self._is_resumed, self._tree, self._progress = resumed_losses is not None, tree, progress
        lanes = np.full(trained.parallel_updates, np.inf, trained.compiled.REAL)
        self.best_losses = lanes if resumed_losses is None else resumed_losses
        self._merged_losses: Any = None

    def __str__(self) -> str:
        return str(self._pgpe)

    def compile(self, *arguments: Any, **named: Any) -> None:
        """Compiles the one that is watched."""
        self._pgpe.compile(*arguments, **named)

    @property
    def initialize(self) -> Callable:
        """JaxPlan's, or what gives back the state that was left."""
        if not self._is_resumed:
            return self._pgpe.initialize

        def restored(key: Any, policy_params: Any) -> Any:
            made = self._pgpe.initialize(key, policy_params)
            return tuple(map(self._tree, TREES, made))

        return restored

    @property
    def update(self) -> Callable:
        """JaxPlan's, whose results are kept."""

        def watched(key: Any, params: Any, r_max: Any, progress: float, *others: Any) -> Any:
            if self._is_resumed:
                progress = self._progress()
            result = self._pgpe.update(key, params, r_max, progress, *others)
            self._carried.update(zip(TREES, (result[0], result[2], result[1]), strict=True))
            self._merged_losses = None
            return result

        return watched

    def merge(self, mask: Any, *arguments: Any) -> Any:
        """In place of `merge_pgpe`: its mask is of the losses of the whole training.

        A loop that goes on takes too many of PGPE's policies for better ones, never too few.
        """
        if self._is_resumed:
            is_lost = ~np.isfinite(self._carried["train_loss"])
            mask = (np.asarray(arguments[4]) < self.best_losses) | is_lost
        result = self._merge(mask, *arguments)
        self._carried["params"], self._merged_losses = result[0], result[2]
        return result

    def passed(self, smoothed_losses: Any) -> None:
        """An iteration is done, with these test losses of the gradient's policies."""
        losses = smoothed_losses if self._merged_losses is None else self._merged_losses
        self.best_losses = np.minimum(self.best_losses, np.asarray(losses))
