"""A policy that plays without a compiled planner."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.policy.file import SavedPlanRule, SavedTable, save_policy
from mdpo_rddl.policy.plan_rule import Simulated
from mdpo_rddl.policy.side_by_side import DistinctStates
from mdpo_rddl.policy.table import Claim, Optimum
from mdpo_rddl.problem.grounding import (
    grounded,
    is_grounded,
    lifted,
    require_observation,
    require_step,
)
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.simulator.evaluation import Replicated

if TYPE_CHECKING:
    from mdpo_rddl.policy.rule.explanation import Explanation


class PlannerlessPolicy(PolicyAgent):
    """What a table and relaxed plans have in common. An agent of pyRDDLGym's.

    Attributes:
      name: of the kind of policy, as summaries have it.
      claim: what is known of its return, for the horizon that it was made for.
      seed: of the run that found it.
    """

    name: ClassVar[str]

    def __init__(self, problem: Problem, claim: Claim | Simulated, seed: int) -> None:
        """Keeps them.

        Args:
          problem: that is played.
          claim: see the class.
          seed: see the class.
        """
        self._problem = problem
        self._claim, self.seed = claim, seed

    @abstractmethod
    def to_saved(self) -> SavedTable | SavedPlanRule:
        """The policy as a file holds it."""

    def save(self, path: str | Path) -> None:
        """Writes one file that stands alone, which `mdpo_rddl.load_policy` reads.

        Raises:
          InputError: naming the file, if it cannot be written.
        """
        save_policy(Path(path), self.to_saved())

    @property
    def problem(self) -> Problem:
        """The parsed problem."""
        return self._problem

    @property
    def optimum(self) -> Optimum | None:
        """What is proven of the policy; None if nothing is."""
        return self._claim if isinstance(self._claim, Optimum) else None

    @property
    def returns(self) -> np.ndarray:
        """The expected return [1], proven or estimated."""
        return np.array([self._claim.value])

    def explain(self, seconds: float = 0.0) -> "Explanation":
        """Says that there is no rule.

        Args:
          seconds: nothing is measured, however many.
        """
        from mdpo_rddl.policy.rule.explanation import Explanation

        return Explanation((), f"the policy is {self.kind}, not a rule")

    @property
    @abstractmethod
    def kind(self) -> str:
        """What it is, in words."""

    def __call__(self, step: int, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The action at a step.

        Args:
          step: number of decisions before this one.
          observation: per state fluent its values [*shape], as the vectorized environment's, or
            per ground fluent a scalar.

        Returns:
          Per action fluent its values [*shape], or per ground action fluent a scalar.

        Raises:
          InputError: if there is no such step, or fluents are unknown, missing or of another shape.
        """
        model = self._problem.model
        require_step(model, step)
        require_observation(model, observation)
        if is_grounded(model, observation):
            return grounded(model, self._act(step, lifted(model, observation)))
        return self._act(step, observation)

    def replicated(self) -> Replicated:
        """See `PolicyAgent.replicated`."""
        return DistinctStates(self.batch, self._problem.model)

    @abstractmethod
    def _act(self, step: int, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The same where all fluents are lifted."""


def numbers_of(observed: Any, objects: Sequence[str]) -> np.ndarray:
    """A fluent's values in a row: of a bool 0 or 1, of an object its number.

    Args:
      observed: its values [*shape].
      objects: the names of those that its values may be, if they are objects.
    """
    values = np.ravel(np.asarray(observed))
    if values.dtype.kind in "UO":
        return np.array([list(objects).index(str(each).removeprefix("@")) for each in values])
    return values.astype(np.int64)
