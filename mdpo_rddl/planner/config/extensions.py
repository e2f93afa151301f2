"""Plans and optimisers of ours that a configuration can name beside JaxPlan's and optax's."""

from collections.abc import Callable
from typing import Any, NamedTuple

from mdpo_rddl.planner.config.values import parameters
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.plans.optimizers import normalized_adam
from mdpo_rddl.planner.plans.state_values import ValueShape
from mdpo_rddl.planner.upstream import JaxPlan


class PlanKind(NamedTuple):
    """A plan of ours.

    Attributes:
      make: makes one.
      parameters: the names of what it is made with.
    """

    make: Callable[..., JaxPlan]
    parameters: set[str]


def _feedback_plan(units: Any = None, **shape: Any) -> FeedbackPlan:
    return FeedbackPlan(FeedbackShape(**shape), units)


def _greedy_plan(samples: int | None = None, **shape: Any) -> GreedyPlan:
    return GreedyPlan(ValueShape(**shape), samples)


PLANS = {
    "FeedbackPlan": PlanKind(_feedback_plan, parameters(FeedbackShape) | {"units"}),
    "GreedyPlan": PlanKind(_greedy_plan, parameters(ValueShape) | {"samples"}),
}
OPTIMIZERS: dict[str, Callable[..., Any]] = {"normalized_adam": normalized_adam}

# what JaxPlan's loader reads in their stead
_STAND_IN_PLAN, _STAND_IN_OPTIMIZER = "JaxStraightLinePlan", "adam"


def stand_ins(planner: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Splits a `[Planner]` section into what JaxPlan's loader knows and what it does not.

    Returns:
      The section with stand-ins for ours, and the planner's arguments that replace them.
    """
    section, ours = dict(planner), {}
    plan, optimizer = section.get("method"), section.get("optimizer")
    if plan in PLANS:
        ours["plan"] = PLANS[plan].make(**section.pop("method_kwargs", {}))
        section["method"] = _STAND_IN_PLAN
    if optimizer in OPTIMIZERS:
        ours["optimizer"] = OPTIMIZERS[optimizer]
        section["optimizer"] = _STAND_IN_OPTIMIZER
    return section, ours
