"""Where JaxPlan's loop hands over what it is about to show."""

from collections.abc import Callable
from typing import Any

from mdpo_rddl.planner.upstream import JaxPlannerStoppingRule

Callback = dict[str, Any]


class CallbackRule(JaxPlannerStoppingRule):
    """A stopping rule that lets a planner edit each callback before the dashboard sees it.

    It is JaxPlan's one hook between the making of a callback and its first reader, and the time
    it takes counts as the loop's.
    """

    def __init__(
        self,
        complete: Callable[[Callback], None],
        rule: JaxPlannerStoppingRule | None,
        finish: Callable[[Callback], None],
    ) -> None:
        """Asks nothing yet.

        Args:
          complete: adds to a callback in place what the rule should see.
          rule: the user's, if there is one.
          finish: what is to be done after that, in place.
        """
        self._complete, self._rule, self._finish = complete, rule, finish

    def reset(self) -> None:
        """The user's rule's."""
        if self._rule is not None:
            self._rule.reset()

    def monitor(self, callback: Callback) -> bool:
        """Whether the user's rule stops here."""
        self._complete(callback)
        stops = self._rule is not None and bool(self._rule.monitor(callback))
        self._finish(callback)
        return stops

    def __str__(self) -> str:
        return str(self._rule)
