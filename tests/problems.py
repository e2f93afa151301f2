"""Small problems and planners that several tests share."""

from pathlib import Path
from typing import Any

import jax
import optax

from mdpo_rddl.jaxplan.upstream import (
    JaxBackpropPlanner,
    JaxDeepReactivePolicy,
    JaxPlan,
    JaxStraightLinePlan,
)
from mdpo_rddl.problem import Problem, load_problem

ROOT = Path(__file__).parent.parent


def shipped(instance: str, horizon: int) -> Problem:
    """One of the six shipped problems, shortened."""
    domain = instance.rstrip("0123456789")
    return load_problem(
        str(ROOT / "domains" / f"{domain}.rddl"),
        str(ROOT / "instances" / f"{instance}.rddl"),
        horizon,
    )


def make_plan(kind: str, **arguments: Any) -> JaxPlan:
    """A fresh plan: "drp" with 12-12 units, or "slp"."""
    if kind == "drp":
        return JaxDeepReactivePolicy(topology=[12, 12], **arguments)
    return JaxStraightLinePlan(**arguments)


def make_planner(planner_class: type, problem: Problem, plan: JaxPlan, **arguments: Any) -> Any:
    """A planner with RMSProp 0.01 and a single rollout, unless told otherwise."""
    defaults = {
        "batch_size_train": 1,
        "batch_size_test": 2,
        "optimizer": optax.rmsprop,
        "optimizer_kwargs": {"learning_rate": 0.01},
        "pgpe": None,
        "compiler_kwargs": {"print_warnings": False, "sigmoid_weight": 100.0},
    }
    return planner_class(problem.model, plan, **{**defaults, **arguments})


def optimize(planner: JaxBackpropPlanner, epochs: int, seed: int = 3, **arguments: Any) -> dict:
    """The last callback of a silent run."""
    return planner.optimize(
        key=jax.random.PRNGKey(seed),
        epochs=epochs,
        print_summary=False,
        print_progress=False,
        **arguments,
    )
