"""From a problem and a configuration to a planner and a policy that can be played."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.evaluation import Policy
from mdpo_rddl.jaxplan.config import PlannerConfig, optimize_parameters
from mdpo_rddl.jaxplan.missing import missing_package
from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.problem import Problem
from mdpo_rddl.stored_programs import stored_jit

# arguments of the compiled calls, or of the loop around them
_BUDGET = {"key": 0, "epochs": 1, "train_seconds": 1.0}


def build_planner(
    problem: Problem,
    config: PlannerConfig,
    programs: Path | None = None,
    planner_class: type[MDPOPlanner] = MDPOPlanner,
) -> tuple[MDPOPlanner, dict[str, Any]]:
    """Compiles a planner.

    Args:
      problem: the parsed problem; its horizon is the rollouts' unless the configuration
        names a `rollout_horizon`.
      config: the planner's configuration.
      programs: where traced programs are kept from one process to the next, if anywhere.
      planner_class: what to make of it.

    Returns:
      The planner, and the keyword arguments that the configuration has for `optimize`.

    Raises:
      InputError: if JaxPlan refuses the problem or the configuration.
    """
    quiet = config.with_values("Compiler", print_warnings=False)
    planner_args, _, train_args = quiet.jaxplan_arguments()
    # the rest of the section is for JaxPlan's controllers
    known = optimize_parameters()
    optimize_args = {name: value for name, value in train_args.items() if name in known}
    try:
        planner = planner_class(problem.model, **planner_args, **config.mdpo_arguments())
    except Exception as error:  # JaxPlan has no exception of its own for what it cannot compile
        cause = missing_package(error) or " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{problem.instance_path}: JaxPlan cannot compile it: {cause} "
            f"(configured by {config.source})"
        ) from error
    if programs is not None:
        text = config.with_values("Optimize", **_BUDGET).to_text()
        identity = f"{problem.digest} {problem.horizon} {text}"
        planner.compile_calls_with(stored_jit(programs, identity))
    return planner, optimize_args


def playable(
    planner: MDPOPlanner, params: Any, policy_hyperparams: Mapping[str, Any], seed: int
) -> Policy:
    """The policy with the given parameters, as `mdpo_rddl.evaluation` plays it.

    Args:
      planner: the planner that the parameters belong to.
      params: parameters of one policy.
      policy_hyperparams: JaxPlan's policy hyperparameters.
      seed: of a policy that draws random numbers; step t uses the t-th key.
    """
    steps = max(planner.horizon, planner.rddl.horizon)
    keys = np.asarray(jax.random.split(jax.random.PRNGKey(seed), steps))
    hyperparams = dict(policy_hyperparams)

    def policy(step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        return planner.get_action(keys[step], params, step, dict(state), hyperparams)

    return policy
