"""JaxPlan's own planner, as its authors configure it."""

import time
from typing import Any

import jax
import numpy as np

from mdpo_rddl.ipc.gradient import Found, GradientPlanner
from mdpo_rddl.planner.baseline import build_baseline
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import own_config
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
        return own_config(REPOSITORY_NAMES.get(problem.domain_name, "default"), self._method)

    def _find(self, problem: Problem, seconds: float, seed: int) -> Found:
        started = time.perf_counter()
        config = self.config(problem)
        planner, arguments = build_baseline(problem, config)
        left = seconds - (time.perf_counter() - started)
        # its clock starts before compilation
        callback = planner.optimize(
            **{
                **arguments,
                "key": jax.random.PRNGKey(seed),
                "epochs": _MANY,
                "train_seconds": max(left, 1.0),
                "print_summary": False,
                "print_progress": False,
                "print_hyperparams": False,
            }
        )
        trees = callback["best_params"], dict(callback["policy_hyperparams"])
        params, hyperparams = jax.tree.map(np.asarray, trees)
        return Found(planner, config, params, hyperparams)

    def _build(self, problem: Problem, config: PlannerConfig) -> Any:
        return build_baseline(problem, config)[0]
