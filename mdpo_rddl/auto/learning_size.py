"""How many rollouts an iteration of `greedy` has, and what it takes at least."""

from mdpo_rddl.auto.judge import ROLLOUTS
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan

LONGEST_SHARE = 0.02
"""Of the race: an iteration that takes longer leaves too few."""

# of an iteration; fewer where decisions try more than so many actions, half where by more samples
_ROLLOUTS, _FEW_ROLLOUTS, _MANY_TRIED = 256, 64, 64
# of the time that its steps of the model would take in the judge's rollouts; the smallest share
# that was measured is 0.33
_LEAST_SHARE = 0.25


def learning_rollouts(plan: GreedyPlan) -> int:
    """Rollouts of an iteration.

    Args:
      plan: compiled.
    """
    most = _ROLLOUTS if plan.tried <= _MANY_TRIED else _FEW_ROLLOUTS
    return most if plan.rollout_samples == 1 else most // 2


def least_seconds(plan: GreedyPlan, batch_seconds: float) -> float:
    """What an iteration takes at least, by the steps of the model that its decisions make.

    Args:
      plan: compiled.
      batch_seconds: that as many rollouts take as the judge has of a candidate.
    """
    samples = learning_rollouts(plan) * plan.rollout_samples * (1 + plan.tried)
    return _LEAST_SHARE * batch_seconds * samples / ROLLOUTS
