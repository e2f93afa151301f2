"""What knowing the future would add: an estimate of it, and a bound where one is known."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.html import html_table
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.policy.hindsight.search import Estimate, find_plans
from mdpo_rddl.problem.episode import Policy
from mdpo_rddl.problem.evaluation import mean_interval
from mdpo_rddl.problem.hindsight.bound import Bounds, find_bounds
from mdpo_rddl.problem.load import Problem

# of the time, what is kept for bounds
_SHARE_OF_BOUNDS = 0.5


@dataclass(frozen=True, eq=False)
class Hindsight:
    """What plans return for which every random number of an episode is known before it begins.

    The estimate is of scenarios of the exact compiled model, on which the policy is played too.
    The bounds are of the policy's own episodes on the exact environment: their mean is at least
    what the policy, and any other one, returns on average.

    Attributes:
      estimate: by the best plans that a search has found; None for a table or a vote.
      bounds: no plan returns more; where the problem is piecewise linear.
    """

    estimate: Estimate | None
    bounds: Bounds

    def to_json(self) -> dict[str, Any]:
        """The figures, as `summary.json` holds them."""
        return {"estimate": self._estimated(), "bound": self._bounded(), "note": self.bounds.reason}

    def _estimated(self) -> dict[str, Any] | None:
        found = self.estimate
        if found is None or not np.all(np.isfinite([found.policy, found.plan])):
            return None
        return {
            "scenarios": len(found.policy),
            "seconds": round(found.seconds, 3),
            **_compared(found.policy, found.plan, "plan"),
        }

    def _bounded(self) -> dict[str, Any] | None:
        episodes = self.bounds.episodes
        if not episodes:
            return None
        policy, bound = (np.array([getattr(e, n) for e in episodes]) for n in ("policy", "bound"))
        attained = sum(each.is_attained for each in episodes)
        return {
            "episodes": len(episodes),
            "attained": attained,
            **_compared(policy, bound, "bound"),
        }

    def _repr_html_(self) -> str:
        figures, rows = self.to_json(), {}
        if (estimate := figures["estimate"]) is not None:
            rows["policy, scenarios"] = f"{estimate['policy_mean_return']:z,.2f}"
            rows["best plans found"] = f"{estimate['plan_mean_return']:z,.2f}"
        if (bound := figures["bound"]) is not None:
            rows["policy, episodes"] = f"{bound['policy_mean_return']:z,.2f}"
            rows["bound"] = f"{bound['bound_mean_return']:z,.2f}"
        if figures["note"] is not None:
            rows["no more bounds"] = figures["note"]
        return html_table("The random numbers known", rows)


def find_hindsight(
    problem: Problem,
    policy: Policy,
    compiled: tuple[MDPOPlanner, Any, Mapping[str, Any]] | None,
    terms: tuple[int, int, float],
    clock: Callable[[], float] = time.monotonic,
) -> Hindsight:
    """What knowing the future would add to a policy's return.

    Args:
      problem: what is played.
      policy: which.
      compiled: its planner, parameters and hyperparameters; None for a table or a vote.
      terms: how many episodes and scenarios, their seed, and the seconds for all.
      clock: tells the seconds.

    Raises:
      InputError: if the episodes or the seconds are none.
    """
    count, seed, seconds = terms
    if count < 1:
        raise InputError(f"episodes must be at least 1, got {count}")
    if not 0.0 < seconds < np.inf:
        raise InputError(f"seconds must be a number above 0, got {seconds!r}")
    until = clock() + seconds
    bounds = find_bounds(problem, policy, count, seed, _SHARE_OF_BOUNDS * seconds, clock)
    estimate = None
    if compiled is not None:
        planner, *parameters = compiled
        left = until - clock()
        estimate = find_plans(planner, tuple(parameters), (count, seed), left, clock)
    return Hindsight(estimate, bounds)


def _compared(policy: np.ndarray, other: np.ndarray, name: str) -> dict[str, Any]:
    """Means of both, and of their difference with its interval."""
    gains = other - policy
    interval = mean_interval(gains)
    return {
        "policy_mean_return": float(np.mean(policy)),
        f"{name}_mean_return": float(np.mean(other)),
        "gain": float(np.mean(gains)),
        "gain_ci95": None if interval is None else list(interval),
        "policy_returns": policy.tolist(),
        f"{name}_returns": other.tolist(),
    }
