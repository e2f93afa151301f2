"""What a policy must return to be better than the no-op."""

import math
from typing import NamedTuple

# what a gain must be of the return of the no-op, to be one
_GAIN = 0.005
# of the standard error of the difference; below 1, so that one success among all rollouts
# counts where the no-op has none
_ERRORS = 0.9
# of the standard error of a mean, for the best of many plans in few rollouts, at each iteration
_LUCK = 4.0


class NoopReturn(NamedTuple):
    """What is known of the no-op's return.

    Attributes:
      mean: over rollouts; minus infinity if it is not finite.
      deviation: standard deviation of one rollout's return.
    """

    mean: float
    deviation: float


def return_to_beat(mean: float, error: float) -> float:
    """What the mean return of a policy must exceed.

    Args:
      mean: of the no-op's return; minus infinity if it is not finite.
      error: standard error of the difference between the policy's mean and this one.
    """
    return _beyond(mean, _ERRORS * error)


def return_to_beat_by_luck(noop: NoopReturn, rollouts: int) -> float:
    """As `return_to_beat`, for the best of many policies.

    Args:
      noop: its return.
      rollouts: of each policy.
    """
    return _beyond(noop.mean, _LUCK * noop.deviation / math.sqrt(rollouts))


def finite_gain(level: float, noop: float) -> float:
    """How far a return is from the no-op's; 0 if one of them is not finite."""
    gain = abs(level - noop)
    return gain if math.isfinite(gain) else 0.0


def _beyond(mean: float, margin: float) -> float:
    if not math.isfinite(mean):
        return -math.inf
    return mean + max(_GAIN * abs(mean), margin)
