"""How many rollouts an iteration of `greedy` has, and what it takes at least."""

from mdpo_rddl.auto.arena.judge import ROLLOUTS
from mdpo_rddl.machine.device import is_on_cpu
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan

# of the race: an iteration that takes longer leaves too few
_LONGEST_SHARE = 0.02
# of an iteration; half of them where actions are tried by several samples. On a CPU, the most that
# make so many steps of the model at each step to find their actions, but not fewer than the fewest;
# on an accelerator, a part of them where decisions try more than so many actions
_ROLLOUTS, _FEWEST_ROLLOUTS, _MOST_STEPS = 256, 32, 2048
_MANY_TRIED, _PART = 64, 4
# of the time that its steps of the model would take in other rollouts, in which policies are more
# than these steps: a guess, so low that what is refused could hardly have been in time
_LEAST_SHARE = 0.2


def learning_rollouts(plan: GreedyPlan) -> int:
    """Rollouts of an iteration.

    Args:
      plan: compiled.
    """
    most = _ROLLOUTS if plan.rollout_samples == 1 else _ROLLOUTS // 2
    if not is_on_cpu():
        return most if plan.tried <= _MANY_TRIED else most // _PART
    fitting = max(1, _MOST_STEPS // max(1, plan.tried * plan.rollout_samples))
    power_of_two: int = 2 ** (fitting.bit_length() - 1)
    return min(most, max(_FEWEST_ROLLOUTS, power_of_two))


def least_seconds(plan: GreedyPlan, batch_seconds: float) -> float:
    """What an iteration is likely to take at least, by the steps that its decisions make.

    Nothing is said for an accelerator, where many steps may take as long as one.

    Args:
      plan: compiled.
      batch_seconds: that as many rollouts take as the judge has of a candidate.
    """
    if not is_on_cpu():
        return 0.0
    samples = learning_rollouts(plan) * plan.rollout_samples * (1 + plan.tried)
    return _LEAST_SHARE * batch_seconds * samples / ROLLOUTS


def is_too_long(seconds: float, race_seconds: float) -> bool:
    """Whether an iteration of so many seconds leaves too few others."""
    return seconds > _LONGEST_SHARE * race_seconds
