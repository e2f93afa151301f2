"""The ground models of one problem, for all who need them."""

from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import GroundModel, OpenModel, ground_model, open_model
from mdpo_rddl.problem.load import Problem


class Grounded:
    """Makes each model when it is first asked for.

    Attributes:
      opened: with the action left open; None before it is asked for, or if it cannot be made.
      model: with the rules of each joint action; None likewise.
    """

    def __init__(self, problem: Problem) -> None:
        """Makes nothing yet."""
        self._problem = problem
        self.opened: OpenModel | None = None
        self.model: GroundModel | None = None

    def ground(self, limits: EnumerationLimits) -> GroundModel:
        """Makes both; their graph is the same.

        Args:
          limits: for what is not there yet.

        Raises:
          NotEnumerableError: as `ground_model`.
        """
        if self.opened is None:
            self.opened = open_model(self._problem, limits)
        if self.model is None:
            self.model = ground_model(self._problem, limits, self.opened)
        return self.model
