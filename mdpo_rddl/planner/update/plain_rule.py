"""Shows a stopping rule JaxPlan's own updates, and nothing of their companions with noise."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.update.pairs import of_lanes
from mdpo_rddl.planner.upstream import JaxPlannerStoppingRule


class PlainUpdatesRule(JaxPlannerStoppingRule):
    """A stopping rule that is shown JaxPlan's own updates alone.

    What a callback says of the best iterate, and whether PGPE improved, is found here as JaxPlan's
    loop finds it, whose own figures are those of all lanes. Its status stays that of all lanes.
    """

    def __init__(
        self,
        rule: JaxPlannerStoppingRule,
        best_of_calls: Callable[[], Mapping[str, Any]] | None = None,
    ) -> None:
        """Has seen nothing yet.

        Args:
          rule: the user's.
          best_of_calls: the entries that calls of several iterations know better, of JaxPlan's own
            updates; None where an iteration is a call.
        """
        self._rule, self._best_of_calls = rule, best_of_calls
        self._forget()

    def _forget(self) -> None:
        self._return: Any = -np.inf
        self._best: dict[str, Any] = {}
        self._losses: Any = np.inf  # the smallest of each update, as PGPE has to undercut it

    def reset(self) -> None:
        """The user's rule's."""
        self._forget()
        self._rule.reset()

    def monitor(self, callback: dict[str, Any]) -> bool:
        """Whether the rule stops at what JaxPlan's callback [R, ...] would be.

        Args:
          callback: that of all lanes [2 R, ...].
        """
        lanes = np.arange(len(callback["test_return"]) // 2)
        entries = {**callback, **of_lanes(callback, lanes)}
        entries |= (
            self._of_iteration(entries) if self._best_of_calls is None else self._best_of_calls()
        )
        return bool(self._rule.monitor(entries))

    def _of_iteration(self, entries: Mapping[str, Any]) -> dict[str, Any]:
        """The entries of the best iterate so far, and of PGPE."""
        returns = np.asarray(entries["test_return"])
        index = int(np.argmax(returns))
        if returns[index] > self._return:
            self._return = returns[index]
            self._best = {
                "best_return": self._return,
                "last_iteration_improved": entries["iteration"],
                "best_params": _at(entries["params"], index),
                "best_grad": _at(entries["grad"], index),
            }
        return {**self._best, "best_index": index, "pgpe_improved": self._pgpe_improved(entries)}

    def _pgpe_improved(self, entries: Mapping[str, Any]) -> bool:
        if entries.get("pgpe_return") is None:
            return False
        ahead = -np.asarray(entries["pgpe_return"]) < self._losses
        self._losses = np.minimum(self._losses, -np.asarray(entries["test_return"]))
        return bool(np.any(ahead | ~np.isfinite(entries["train_return"])))

    def __str__(self) -> str:
        return str(self._rule)


def _at(tree: Any, index: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], tree)
