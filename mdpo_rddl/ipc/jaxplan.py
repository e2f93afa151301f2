"""JaxPlan's own planner, as its authors configure it."""

from typing import Any

import jax
import numpy as np

from mdpo_rddl.experiments.jaxplan_baseline import build_baseline
from mdpo_rddl.ipc.gradient import GradientPlanner
from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.jaxplan.own_configs import own_config
from mdpo_rddl.presets.shipped import REPOSITORY_NAMES
from mdpo_rddl.problem import Problem

_MANY = 10_000_000


class JaxPlanPlanner(GradientPlanner):
    """`JaxBackpropPlanner` with JaxPlan's configuration for the domain, else its default.

    Only the time and the number of iterations are replaced by the run's. Its actions are played
    as they are.
    """

    def __init__(self, method: str) -> None:
        """Takes "slp", a straight-line plan, or "drp", a deep reactive policy."""
        self._method = method

    def _config(self, problem: Problem) -> PlannerConfig:
        return own_config(REPOSITORY_NAMES.get(problem.domain_name, "default"), self._method)

    def _build(self, problem: Problem, config: PlannerConfig) -> tuple[Any, dict[str, Any]]:
        return build_baseline(problem, config)

    def _train(
        self, planner: Any, arguments: dict[str, Any], seed: int, seconds: float
    ) -> tuple[Any, dict[str, Any]]:
        # its clock starts before compilation
        callback = planner.optimize(
            **{
                **arguments,
                "key": jax.random.PRNGKey(seed),
                "epochs": _MANY,
                "train_seconds": seconds,
                "print_summary": False,
                "print_progress": False,
                "print_hyperparams": False,
            }
        )
        trees = callback["best_params"], dict(callback["policy_hyperparams"])
        params, hyperparams = jax.tree.map(np.asarray, trees)
        return params, hyperparams
