"""Ways to find a policy."""

from collections.abc import Sequence

from mdpo_rddl.race.arm import Arm
from mdpo_rddl.race.arms import weights


def portfolio() -> Sequence[Arm]:
    """All arms, in the order in which they begin."""
    return weights.rules(), weights.shared_weights(), weights.own_weights()
