"""The figures of a session, as `summary.json` holds them."""

import logging
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from mdpo_rddl.machine.device import current_device
from mdpo_rddl.machine.files import finite_or_none
from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.plannerless import PlannerlessPolicy
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.problem.load import Problem

if TYPE_CHECKING:  # which import JAX
    from mdpo_rddl.planner.planner import MDPOPlanner
    from mdpo_rddl.planner.training.training import TrainingResult

logger = logging.getLogger(__name__)

_NOISE_NAMES = {"ConstantNoise": "constant", "AdaptiveNoise": "adaptive"}
# where each update with noise has one without beside it
_BESIDE = ", beside updates without"
_POLICY_NAMES = {
    "JaxDeepReactivePolicy": "drp",
    "JaxStraightLinePlan": "slp",
    "FeedbackPlan": "feedback",
    "GreedyPlan": "greedy",
}


def identity(
    problem: Problem,
    figures: Mapping[str, Any],
    *,
    config_name: str,
    seed: int,
    episodes: int,
) -> dict[str, Any]:
    """Which problem, noise, policy and seed.

    Args:
      problem: the parsed problem.
      figures: `planner_figures` or `policy_figures`.
      config_name: what to call it: the preset or the file.
      seed: of the run.
      episodes: that the policy is played.
    """
    return {
        "domain": problem.domain_name,
        "instance": problem.instance_name,
        "label": problem.label,
        "horizon": problem.horizon,
        "config": config_name,
        **figures,
        "seed": seed,
        "episodes": episodes,
    }


def planner_figures(config: PlannerConfig) -> dict[str, Any]:
    """The noise and the kind of policy of a configuration.

    Without a section `[Noise]` all numbers of the default are given, since nobody has named one.
    """
    plan, noise, numbers = config.policy_method, "none", config.noise_numbers
    if config.section("Noise").get("method") != "NoNoise":  # other rules import JAX
        rule = config.noise()
        name = type(rule).__name__
        noise = _NOISE_NAMES.get(name, name)
        noise += _BESIDE if rule.paired and not rule.silent else ""
        numbers = numbers if "Noise" in config.sections else asdict(cast(Any, rule))
    policy = _POLICY_NAMES.get(plan, plan)
    return {"noise": noise, "noise_parameters": numbers, "policy": policy}


def policy_figures(policy: AnyPolicy) -> dict[str, Any]:
    """The noise that a policy was trained with, and its kind."""
    if isinstance(policy, PlannerlessPolicy):
        return {"noise": "none", "noise_parameters": {}, "policy": policy.name}
    figures = planner_figures(policy.config)
    return {**figures, "policy": "vote over a belief"} if policy.votes else figures


def optimum_figures(policy: AnyPolicy) -> dict[str, Any]:
    """The entry `optimum`, of a policy that is proven to be the best; else nothing."""
    if not isinstance(policy, PlannerlessPolicy) or policy.optimum is None:
        return {}
    return {"optimum": asdict(policy.optimum)}


def return_figures(evaluation: Evaluation) -> dict[str, Any]:
    """What the exact environment paid."""
    interval = evaluation.ci95
    return {
        "mean_return": finite_or_none(evaluation.mean),
        "std_return": finite_or_none(evaluation.std),
        "ci95": None if interval is None else [finite_or_none(bound) for bound in interval],
        "returns": [finite_or_none(value) for value in evaluation.returns.tolist()],
        "episode_lengths": evaluation.lengths.tolist(),
        "illegal_actions": evaluation.illegal_actions,
        "fallback_actions": evaluation.fallback_actions,
        "steps": int(np.sum(evaluation.lengths)),
        "unplayable_steps": int(np.sum(evaluation.unplayable)),
        "unmet_preconditions": list(evaluation.unmet),
    }


def warn_of_unplayable(evaluation: Evaluation) -> None:
    """Warns where nobody can play what a policy does, which is no result then."""
    count = int(np.sum(evaluation.unplayable))
    if not count:
        return
    steps, told = int(np.sum(evaluation.lengths)), "; ".join(evaluation.unmet)
    logger.warning(
        "the plan cannot be executed: at %s of %s steps no legal action was found%s",
        f"{count:,}",
        f"{steps:,}",
        f", by the precondition {told}" if told else "",
    )


def not_played_figures(cause: str) -> dict[str, Any]:
    """The entries of `return_figures` where the environment fails, and why."""
    return {**no_return_figures(), "not_played": cause}


def no_return_figures() -> dict[str, Any]:
    """The entries of `return_figures` where no episode has ended."""
    return {
        "mean_return": None,
        "std_return": None,
        "ci95": None,
        "returns": [],
        "episode_lengths": [],
        "illegal_actions": 0,
        "fallback_actions": 0,
        "steps": 0,
        "unplayable_steps": 0,
        "unmet_preconditions": [],
    }


def training_figures(planner: "MDPOPlanner", result: "TrainingResult") -> dict[str, Any]:
    """How training went, on what."""
    counted = {
        "not_finite": result.not_finite,
        "lost_sensitivities": result.lost_sensitivities,
    }
    return {
        "iterations": result.iterations,
        "best_iteration": result.best_iteration,
        "restarts": planner.restarts,
        "restart": result.restart,
        "batch": planner.batch_size_train,
        "status": result.status,
        **({} if result.advice is None else {"advice": result.advice}),
        **{name: value for name, value in counted.items() if value},
        "train_seconds": result.train_seconds,
        "compile_seconds": result.compile_seconds,
        "device": str(current_device()),
        "versions": package_versions(),
    }


def title(summary: Mapping[str, Any]) -> str:
    """One line for the head of a picture."""
    return (
        f"{summary['label']} (H = {summary['horizon']}), {summary['policy']}, "
        f"{summary['noise']} noise, seed {summary['seed']}"
    )
