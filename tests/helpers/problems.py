"""Small problems and planners that several tests share, and where to find others."""

import inspect
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax

from mdpo_rddl.planner.upstream import (
    JaxBackpropPlanner,
    JaxDeepReactivePolicy,
    JaxPlan,
    JaxStraightLinePlan,
)
from mdpo_rddl.problem.load import Problem, load_problem

ROOT = Path(__file__).parents[2]
JAXPLAN_EXAMPLES = Path(inspect.getfile(JaxBackpropPlanner)).parents[1] / "examples"
# PGPE is annealed with the share of the time used, which must not depend on the machine
FOREVER = 1e300


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


def assert_same_bits(ours: Any, theirs: Any) -> None:
    """Two trees are equal, bit for bit and in their types."""
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for mine, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_array_equal(np.asarray(mine), np.asarray(other), strict=True)


# every action moves one unit; the last one comes too late to matter
TINY_DOMAIN = """
domain tiny {
    types { unit : object; };
    pvariables {
        GOAL : { non-fluent, real, default = 0.5 };
        SPREAD : { non-fluent, real, default = 0.0 };
        x(unit) : { state-fluent, real, default = 0.0 };
        push(unit) : { action-fluent, real, default = 0.0 };
    };
    cpfs { x'(?u) = x(?u) + push(?u) + SPREAD * Normal(0.0, 1.0); };
    reward = -(sum_{?u : unit} [pow[x(?u) - GOAL, 2]]);
    action-preconditions { forall_{?u : unit} [push(?u) >= -1.0 ^ push(?u) <= 1.0]; };
}
"""
TINY_INSTANCE = """
non-fluents nf {
    domain = tiny;
    objects { unit : {u1, u2}; };
    non-fluents { SPREAD = _SPREAD; };
}
instance one {
    domain = tiny;
    non-fluents = nf;
    max-nondef-actions = pos-inf;
    horizon = _HORIZON;
    discount = 1.0;
}
"""


def tiny_files(folder: Path, horizon: int = 4, spread: float = 0.0) -> tuple[str, str]:
    """Writes a problem that compiles fast: two units to move to a goal, real actions."""
    domain, instance = folder / "d.rddl", folder / "i.rddl"
    domain.write_text(TINY_DOMAIN)
    text = TINY_INSTANCE.replace("_HORIZON", str(horizon)).replace("_SPREAD", str(spread))
    instance.write_text(text)
    return str(domain), str(instance)


# a corridor with a prize beyond a trap: only who comes to a stop in the trap leaves it onwards
CORRIDOR_DOMAIN = """
domain corridor {
    pvariables {
        x : { state-fluent, real, default = 0.0 };
        step : { action-fluent, real, default = 0.0 };
        take : { action-fluent, bool, default = false };
    };
    cpfs { x' = if (x >= 2.0 ^ x <= 2.5 ^ step > 0.0) then 0.0 else max[0.0, x + step]; };
    reward = (if (x > 4.0 ^ x < 4.2 ^ take) then 100.0 else 0.0) - 0.1 * take;
    action-preconditions { step >= -1.0; step <= 1.0; };
}
"""
CORRIDOR_INSTANCE = """
non-fluents nf { domain = corridor; }
instance one {
    domain = corridor; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 20;
    discount = 1.0;
}
"""


def write_corridor(folder: Path) -> Problem:
    """The corridor's problem: nothing but the prize is worth anything."""
    domain, instance = folder / "corridor.rddl", folder / "one.rddl"
    domain.write_text(CORRIDOR_DOMAIN)
    instance.write_text(CORRIDOR_INSTANCE)
    return load_problem(str(domain), str(instance))
