"""Ways to find a policy."""

from collections.abc import Sequence

from mdpo_rddl.race.arm import Arm
from mdpo_rddl.race.arms.belief import belief_vote
from mdpo_rddl.race.arms.gradients import feedback_gradient, plan_gradient
from mdpo_rddl.race.arms.greedy import greedy_arm
from mdpo_rddl.race.arms.ground import dynamic_programming, relaxed_plans
from mdpo_rddl.race.arms.plans import plans
from mdpo_rddl.race.arms.weights import own_weights, rules, shared_weights


def portfolio(keeps_values: bool = False) -> Sequence[Arm]:
    """All arms, in the order in which they begin.

    Args:
      keeps_values: whether the optimum comes with the states' values.
    """
    return (
        dynamic_programming(keeps_values),
        relaxed_plans(),
        belief_vote(),
        rules(),
        plans(),
        greedy_arm(),
        shared_weights(),
        own_weights(),
        feedback_gradient(),
        plan_gradient(),
    )
