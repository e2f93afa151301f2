"""What the noisy update asks of a compiled plan, beyond JaxPlan's own interface."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jax import Array

from mdpo_rddl.planner.plans.limited_bools import Shift, shift_jaxplan
from mdpo_rddl.planner.rollouts.plan_memory import NO_MEMORY, PlanMemory
from mdpo_rddl.planner.upstream import JaxDeepReactivePolicy, JaxPlan, JaxStraightLinePlan
from mdpo_rddl.problem.limits import GroupLimit


@runtime_checkable
class OpenedPlan(Protocol):
    """A compiled plan that says where noise can enter.

    Attributes:
      squashes: whether numbers are squashed into their box, and not clipped.
      is_legal: whether its test policy's actions are legal, limits on groups of bools included.
      is_softmax: whether a limit on the number of true bools is kept by a softmax or top-k,
        whose noise is Gumbel's.
      units: per real or integer action fluent what the noise's unit is [*shape]; 1 where it is
        not named.
      concurrency: the plan's own limits on its bools.
      probabilities: the policy's probabilities of the bools before any limit; its arguments are
        those of JaxPlan's policies.
      action_gradients: takes from the gradient of the parameters that with respect to the raw
        actions; None where a plan cannot.
      memory: what rollouts and play carry from step to step for the policy.
    """

    squashes: bool
    is_legal: bool
    is_softmax: bool
    units: Mapping[str, np.ndarray]
    concurrency: Sequence[GroupLimit]
    probabilities: Callable[..., dict[str, Array]]
    action_gradients: Callable[[Any], dict[str, Array]] | None
    memory: PlanMemory

    def shift_for(self, names: Sequence[str]) -> Shift | None:
        """How to perturb the limited bools of these names; None where nobody knows."""


class _OpenedJaxPlan:
    """One of JaxPlan's own plans, or of an unknown kind."""

    is_legal = False
    units: Mapping[str, np.ndarray] = {}
    concurrency: Sequence[GroupLimit] = ()
    action_gradients: Callable[[Any], dict[str, Array]] | None = None
    memory: PlanMemory = NO_MEMORY

    def __init__(self, plan: JaxPlan) -> None:
        is_network = isinstance(plan, JaxDeepReactivePolicy)
        is_straight = isinstance(plan, JaxStraightLinePlan)
        self._plan = plan
        self.probabilities: Callable[..., dict[str, Array]] = plan.train_policy
        self.squashes: bool = (is_network or is_straight) and bool(plan._wrap_non_bool)
        self.is_softmax: bool = is_network or (is_straight and bool(plan._wrap_softmax))

    def shift_for(self, names: Sequence[str]) -> Shift | None:
        return shift_jaxplan(self._plan, names)


def open_plan(plan: JaxPlan) -> OpenedPlan:
    """A compiled plan as the noisy update sees it.

    Args:
      plan: one that says it all itself, or any other plan of JaxPlan's kind.
    """
    return plan if isinstance(plan, OpenedPlan) else _OpenedJaxPlan(plan)
