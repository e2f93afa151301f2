"""What the tests of training train."""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training.training import Progress, TrainingResult, train
from mdpo_rddl.planner.upstream import planner as jaxplan
from mdpo_rddl.problem.load import Problem, load_problem

HORIZON = 5
FOREVER = 1e6
KEY = jax.random.PRNGKey(3)


def reservoir() -> Problem:
    return load_problem("Reservoir_ippc2023", "2", HORIZON)


def paper_config(**planner_values: Any):
    # an iteration a call, as JaxPlan; calls of several are tested in test_calls.py
    config = PRESETS["paper"]("reservoir_control_cont").with_section("MDPO", {})
    return config.with_values("Planner", **planner_values)


def trained(
    planner: Any, iterations: int, seconds: float = FOREVER, key: Any = KEY, **kwargs: Any
) -> tuple[TrainingResult, list[Progress]]:
    progress: list[Progress] = []
    built = Built(planner, Budget(iterations, seconds), kwargs.pop("arguments", {}))
    return train(built, key, **{"on_progress": progress.append, **kwargs}), progress


class Scripted:
    """In place of a planner: given smoothed test returns per iteration and restart.

    The parameter of restart r at iteration i is 100 i + r, its noise i at each of two steps.
    """

    in_calls = False

    def __init__(
        self,
        returns: Iterable[list[float]],
        last_status: str = "ITER_BUDGET_REACHED",
        interrupted_run: int | None = None,
    ) -> None:
        self.returns, self.last_status = list(returns), last_status
        self.interrupted_run, self.runs = interrupted_run, 0

    def call_sizes(self, *sizes: int) -> contextlib.nullcontext[None]:
        return contextlib.nullcontext()

    def optimize_generator(self, **kwargs: Any) -> Iterator[dict[str, Any]]:
        self.runs += 1
        if self.interrupted_run == self.runs - 1:
            raise KeyboardInterrupt
        for i, returns in enumerate(self.returns):
            restarts = np.arange(len(returns), dtype=float)
            last = i == len(self.returns) - 1
            yield {
                "iteration": i,
                "status": jaxplan.JaxPlannerStatus[self.last_status if last else "NORMAL"],
                "train_return": restarts,
                "test_return": np.array(returns),
                "params": {"w": 100 * i + restarts},
                "policy_hyperparams": {"push": 1.0},
                "sigma": np.full((len(returns), 2), float(i)),
            }


CART = """
domain cart {
    pvariables {
        x : { state-fluent, real, default = 3.0 };
        push : { action-fluent, real, default = 0.0 };
    };
    cpfs { x' = x + push; };
    reward = -(x' * x');
}
"""
CART_INSTANCE = """
non-fluents nf_cart { domain = cart; }
instance one {
    domain = cart;
    non-fluents = nf_cart;
    max-nondef-actions = pos-inf;
    horizon = 2;
    discount = 1.0;
}
"""


def cart_planner(folder: Path, noise: str = "NoNoise", **values: Any) -> MDPOPlanner:
    (folder / "cart.rddl").write_text(CART)
    (folder / "one.rddl").write_text(CART_INSTANCE)
    problem = load_problem(str(folder / "cart.rddl"), str(folder / "one.rddl"))
    values = {"method": "JaxStraightLinePlan", "method_kwargs": {}} | values
    config = paper_config(**values).with_section("Noise", {"method": noise})
    return build_planner(problem, config).planner
