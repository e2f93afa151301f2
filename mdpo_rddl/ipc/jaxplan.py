"""JaxPlan's own planner, as its authors configure it."""

import time
from typing import Any

import jax

from mdpo_rddl.ipc.gradient import Found, GradientPlanner
from mdpo_rddl.planner.baseline import train_baseline
from mdpo_rddl.planner.build import build_baseline
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.problem.competition import REPOSITORY_NAMES
from mdpo_rddl.problem.load import Problem

_MANY = 10_000_000


class JaxPlanPlanner(GradientPlanner):
    """`JaxBackpropPlanner` with JaxPlan's configuration for the domain, else its default.

    Only the time and the number of iterations are replaced by the run's. Its actions are played
    as they are.
    """

    def __init__(self, method: str) -> None:
        """Takes "slp", a straight-line plan, or "drp", a deep reactive policy."""
        self._method = method

    def config(self, problem: Problem) -> PlannerConfig:
        """JaxPlan's configuration for the problem's domain."""
        return jaxplan_config(REPOSITORY_NAMES.get(problem.domain_name, "default"), self._method)

    def _find(self, problem: Problem, seconds: float, seed: int) -> Found:
        started = time.perf_counter()
        config = self.config(problem)
        built = build_baseline(problem, config)
        left = seconds - (time.perf_counter() - started)
        budget = Budget(_MANY, max(left, 1.0))
        trained = train_baseline(built, jax.random.PRNGKey(seed), budget, counts_compilation=True)
        return Found(trained.planner, config, trained.params, trained.policy_hyperparams)

    def _build(self, problem: Problem, config: PlannerConfig) -> Any:
        return build_baseline(problem, config).planner
