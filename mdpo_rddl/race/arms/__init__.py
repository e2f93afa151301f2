"""Ways to find a policy."""

from collections.abc import Sequence

from mdpo_rddl.race.arm import Arm
from mdpo_rddl.race.arms.greedy import greedy_arm
from mdpo_rddl.race.arms.weights import own_weights, rules, shared_weights


def portfolio() -> Sequence[Arm]:
    """All arms, in the order in which they begin."""
    return rules(), greedy_arm(), shared_weights(), own_weights()
