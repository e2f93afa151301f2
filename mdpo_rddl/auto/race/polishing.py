"""The arm that searches around the best policy of the arena's planner."""

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.arms.own_weights import Around, OwnWeightsArm
from mdpo_rddl.auto.arms.plan_search import Evolving, PlanArm

_POLISHED, _SIGMA = "polished", 0.01


def polishing_arm(arena: Arena, has_plan: bool) -> Arm:
    """Changes the policy's plan or its weights a little.

    Args:
      arena: where the arms meet.
      has_plan: whether its plan is what made the policy the best.
    """
    if has_plan:
        return PlanArm("polishing the plan", arena, Evolving(False, True, _POLISHED))
    return OwnWeightsArm("polishing the weights", arena, Around(None, _SIGMA, _POLISHED))
