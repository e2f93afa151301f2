"""From a problem and a configuration to a compiled planner, ours or JaxPlan's."""

import warnings
from pathlib import Path
from typing import Any

import jax

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.bounds import too_large_for
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.values import optimize_parameters
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.programs.quick import Jit
from mdpo_rddl.planner.programs.stored import stored_jit
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.problem.enumeration.model import require_actions
from mdpo_rddl.problem.load import Problem, functions_by_name
from mdpo_rddl.problem.sizes import long_integer

# dictionaries of values by action fluent
_BY_ACTION = (("Planner", "action_bounds"), ("Optimize", "policy_hyperparams"))
# arguments of the compiled calls, or of the loop around them
_NOT_COMPILED = {"key": 0, "epochs": 1, "train_seconds": 1.0}


def build_planner(
    problem: Problem,
    config: PlannerConfig,
    traced_cache: Path | None = None,
    planner_class: type[MDPOPlanner] = MDPOPlanner,
    jit: Jit = jax.jit,
) -> Built[MDPOPlanner]:
    """Compiles a planner.

    Args:
      problem: the parsed problem; its horizon is the rollouts' unless the configuration
        names a `rollout_horizon`.
      config: the planner's configuration.
      traced_cache: where traced programs are kept from one process to the next, if anywhere.
      planner_class: what to make of it.
      jit: compiles its calls of several iterations.

    Raises:
      InputError: if JaxPlan refuses the problem or the configuration, or the latter makes too
        large a planner of the former.
    """
    planner_args, optimize_args = _arguments(problem, config)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is no box, as when the problem was loaded
            planner = planner_class(problem.model, **planner_args, **config.mdpo_arguments())
    except InputError:
        raise
    except Exception as error:  # JaxPlan has no exception of its own for what it cannot compile
        cause = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{problem.instance_path}: JaxPlan cannot compile it: {cause} "
            f"(configured by {config.source})"
        ) from error
    planner.lose_on_error = problem.raises
    functions = problem.functions
    # what functions from no file do is not known
    if traced_cache is not None and (functions is None or functions.digest is not None):
        text = config.with_values("Optimize", **_NOT_COMPILED).to_text()
        identity = f"{problem.digest} {problem.horizon} {text}"
        jit = stored_jit(traced_cache, identity, jit=jit)
    if jit is not jax.jit:
        planner.compile_calls_with(jit)
    return Built(planner, config.budget(), optimize_args)


def build_baseline(problem: Problem, config: PlannerConfig) -> Built[JaxBackpropPlanner]:
    """Compiles JaxPlan's own planner, unmodified.

    Args:
      problem: the parsed problem.
      config: a configuration; sections that JaxPlan does not know have no effect.

    Raises:
      InputError: if it makes too large a planner of the problem.
    """
    planner_args, optimize_args = _arguments(problem, config)
    planner = JaxBackpropPlanner(problem.model, **planner_args)
    return Built(planner, config.budget(), optimize_args)


def _require_short_integers(problem: Problem) -> None:
    """Raises `InputError` where an integer of the files has more bits than the compiled model's."""
    if (found := long_integer(problem.model.ast)) is not None:
        file, what = found
        path = problem.domain_path if file == "domain" else problem.instance_path
        raise InputError(f"{path}: {what}")


def _arguments(problem: Problem, config: PlannerConfig) -> tuple[dict[str, Any], dict[str, Any]]:
    """The keyword arguments of JaxPlan's planner, and of its `optimize`."""
    too_large = too_large_for(problem, config.sections)
    if too_large is not None:
        raise InputError(f"{config.source}: {too_large}")
    require_actions(problem)
    if not config.sections.get("Compiler", {}).get("use64bit"):
        _require_short_integers(problem)
    for section, key in _BY_ACTION:
        given = config.sections.get(section, {}).get(key)
        for name in given if isinstance(given, dict) else ():
            if name not in problem.model.action_fluents:
                raise InputError(
                    f"{config.source}: [{section}] {key}: there is no action fluent {name!r}"
                )
    quiet = config.with_values("Compiler", print_warnings=False)
    planner_args, _, train_args = quiet.jaxplan_arguments()
    # the rest of the section is for JaxPlan's controllers
    known = optimize_parameters()
    if problem.functions is not None:
        planner_args = {**planner_args, "python_functions": functions_by_name(problem)}
    return planner_args, {name: value for name, value in train_args.items() if name in known}
