"""JaxPlan's own planner, unmodified, as the baseline of a measurement."""

from typing import Any, NamedTuple

import jax

from mdpo_rddl.planner.config.config import PlannerConfig, optimize_parameters
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.problem.load import Problem


class TrainedBaseline(NamedTuple):
    """A planner of JaxPlan's with the best parameters by its own judgement."""

    planner: JaxBackpropPlanner
    params: Any
    policy_hyperparams: Any
    iterations: int


def build_baseline(
    problem: Problem, config: PlannerConfig
) -> tuple[JaxBackpropPlanner, dict[str, Any]]:
    """JaxPlan's planner, and the keyword arguments that the configuration has for `optimize`.

    Args:
      problem: the parsed problem.
      config: a configuration; sections that JaxPlan does not know have no effect.
    """
    quiet = config.with_values("Compiler", print_warnings=False)
    planner_args, _, train_args = quiet.jaxplan_arguments()
    # the rest of the section is for JaxPlan's controllers
    known = optimize_parameters()
    optimize_args = {name: value for name, value in train_args.items() if name in known}
    return JaxBackpropPlanner(problem.model, **planner_args), optimize_args


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
    planner, optimize_args = build_baseline(problem, config)
    arguments = {
        **optimize_args,
        "key": jax.random.PRNGKey(seed),
        "epochs": iterations,
        "train_seconds": seconds,
        "print_summary": False,
        "print_progress": False,
        "print_hyperparams": False,
    }
    first = planner.optimize_generator(**arguments)
    next(first)
    first.close()
    callback = planner.optimize(**arguments)
    return TrainedBaseline(
        planner, callback["best_params"], callback["policy_hyperparams"], callback["iteration"] + 1
    )
