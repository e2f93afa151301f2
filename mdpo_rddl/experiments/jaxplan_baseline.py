"""JaxPlan's own planner, unmodified, as the baseline of a measurement."""

from typing import Any, NamedTuple

import jax

from mdpo_rddl.jaxplan.config import PlannerConfig, optimize_parameters
from mdpo_rddl.jaxplan.upstream import JaxBackpropPlanner
from mdpo_rddl.problem import Problem


class TrainedBaseline(NamedTuple):
    """A planner of JaxPlan's with the best parameters by its own judgement."""

    planner: JaxBackpropPlanner
    params: Any
    policy_hyperparams: Any
    iterations: int


def train_baseline(
    problem: Problem, config: PlannerConfig, seed: int, iterations: int, seconds: float
) -> TrainedBaseline:
    """Trains `JaxBackpropPlanner`; compilation is not counted.

    Args:
      problem: the parsed problem.
      config: a configuration; sections that JaxPlan does not know have no effect.
      seed: of `jax.random.PRNGKey`.
      iterations: largest number, at least 2.
      seconds: largest training time.
    """
    quiet = config.with_values("Compiler", print_warnings=False)
    planner_args, _, train_args = quiet.jaxplan_arguments()
    # the budget is the measurement's, and the rest of the section is for JaxPlan's controllers
    known = optimize_parameters()
    arguments = {
        **{name: value for name, value in train_args.items() if name in known},
        "key": jax.random.PRNGKey(seed),
        "epochs": iterations,
        "train_seconds": seconds,
        "print_summary": False,
        "print_progress": False,
        "print_hyperparams": False,
    }
    planner = JaxBackpropPlanner(problem.model, **planner_args)
    first = planner.optimize_generator(**arguments)
    next(first)
    first.close()
    callback = planner.optimize(**arguments)
    return TrainedBaseline(
        planner, callback["best_params"], callback["policy_hyperparams"], callback["iteration"] + 1
    )
