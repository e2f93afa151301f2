"""One planning session: train and evaluate, or evaluate what an earlier one saved."""

import contextlib
import importlib.metadata
import logging
import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import jax

from mdpo_rddl.errors import InputError
from mdpo_rddl.evaluation import Evaluation, evaluate
from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.planning import build_planner, playable
from mdpo_rddl.problem import Problem, load_problem, make_environment
from mdpo_rddl.report.policy_file import SavedPolicy, load_policy, problem_identity
from mdpo_rddl.report.run_folder import (
    POLICY,
    SUMMARY,
    RunFolder,
    write_json,
    write_training,
)
from mdpo_rddl.training import Progress, TrainingResult, train

logger = logging.getLogger(__name__)

# JaxPlan's own defaults for a configuration that names no budget
_JAXPLAN_EPOCHS = 999999
_JAXPLAN_SECONDS = 120.0

_NOISE_NAMES = {"NoNoise": "none", "ConstantNoise": "constant", "AdaptiveNoise": "adaptive"}
_POLICY_NAMES = {"JaxDeepReactivePolicy": "drp", "JaxStraightLinePlan": "slp"}
_PACKAGES = ("mdpo-rddl", "pyRDDLGym", "pyRDDLGym-jax", "jax", "jaxlib", "optax", "numpy")


class Reporter(Protocol):
    """Who wants to know how a session gets on."""

    def stage(self, name: str) -> None:
        """A new stage begins."""

    def training(self, progress: Progress) -> None:
        """An iteration is done."""

    def episode(self, done: int, of: int) -> None:
        """An evaluation episode is done."""


@dataclass(frozen=True)
class PlanRequest:
    """What to plan and how.

    Attributes:
      problem: the parsed problem.
      config: the planner's configuration; its `[Optimize]` section holds the budget.
      config_name: what to call it in the summary: the preset or the file.
      seed: of training and evaluation.
      episodes: evaluation episodes on the exact environment.
      out: where the run folder goes.
    """

    problem: Problem
    config: PlannerConfig
    config_name: str
    seed: int
    episodes: int
    out: Path


def plan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Trains a policy, evaluates it exactly and writes the run folder.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: if the problem, the configuration or the folder cannot be used; nothing
        is left behind then.
    """
    with RunFolder(request.out) as folder:
        reporter.stage("compiling")
        planner, optimize_args = build_planner(request.problem, request.config)
        budget = {
            "iterations": optimize_args.pop("epochs", _JAXPLAN_EPOCHS),
            "seconds": optimize_args.pop("train_seconds", _JAXPLAN_SECONDS),
        }
        for name in ("key", "print_summary", "print_progress", "print_hyperparams"):
            optimize_args.pop(name, None)
        try:
            result = train(
                planner,
                key=jax.random.PRNGKey(request.seed),
                **budget,
                optimize_kwargs=optimize_args,
                on_progress=reporter.training,
            )
        except InputError as error:
            raise InputError(
                f"{request.problem.instance_path}: {error} (configured by {request.config.source})"
            ) from error
        saved = SavedPolicy(
            params=result.best_params,
            policy_hyperparams=dict(result.policy_hyperparams),
            config=request.config.to_text(),
            problem=problem_identity(request.problem),
            seed=request.seed,
        )
        reporter.stage("evaluating")
        evaluator = _Evaluator(request, planner, result.policy_hyperparams, reporter)
        best = evaluator.run(result.best_params)
        last = evaluator.run(result.last_params)
        summary = {
            **_identity(request, planner),
            **_figures(best),
            "last_iterate": _figures(last),
            **_training_figures(planner, result),
        }
        config = {
            "source": request.config_name,
            "sections": request.config.sections,
            "seed": request.seed,
            "episodes": request.episodes,
        }
        with folder.writing():
            write_training(folder.staging, result, saved, config, _title(summary))
            write_json(folder.staging / SUMMARY, summary)
        folder.commit()
    return summary


@dataclass(frozen=True)
class LoadRequest:
    """Which saved policy to evaluate on which problem.

    Attributes:
      domain, instance, horizon: as `load_problem` takes them; the saved horizon if None.
      folder: a run folder.
      seed: of the evaluation; the saved run's if None.
      episodes: evaluation episodes on the exact environment.
      out: where to write the new summary, if anywhere.
    """

    domain: str
    instance: str
    folder: Path
    episodes: int
    seed: int | None = None
    horizon: int | None = None
    out: Path | None = None


def evaluate_saved(request: LoadRequest, reporter: Reporter) -> dict[str, Any]:
    """Evaluates a saved policy exactly, with the same returns for the same seed.

    Raises:
      InputError: if the folder is missing, damaged or of another problem, or the new one
        cannot be written.
    """
    path = request.folder / POLICY
    if not request.folder.is_dir():
        raise InputError(f"{request.folder}: no such run folder")
    if request.out is not None and request.out.resolve() == request.folder.resolve():
        raise InputError(f"{request.out}: not overwritten: the policy is loaded from it")
    saved = load_policy(path)
    horizon = saved.problem["horizon"] if request.horizon is None else request.horizon
    problem = load_problem(request.domain, request.instance, horizon)
    _require_same_problem(path, saved, problem)
    config = PlannerConfig.from_text(saved.config, str(path))
    seed = saved.seed if request.seed is None else request.seed

    with contextlib.ExitStack() as stack:
        folder = None if request.out is None else stack.enter_context(RunFolder(request.out))
        reporter.stage("compiling")
        planner, _ = build_planner(problem, config)
        _require_params(path, planner, saved)
        played = PlanRequest(
            problem, config, str(path), seed, request.episodes, request.out or request.folder
        )
        reporter.stage("evaluating")
        evaluator = _Evaluator(played, planner, saved.policy_hyperparams, reporter)
        summary = {
            **_identity(played, planner),
            **_figures(evaluator.run(saved.params)),
            "loaded_from": str(request.folder),
            "versions": _versions(),
        }
        if folder is not None:
            with folder.writing():
                write_json(folder.staging / SUMMARY, summary)
            folder.commit()
    return summary


@dataclass
class _Evaluator:
    request: PlanRequest
    planner: MDPOPlanner
    policy_hyperparams: Mapping[str, Any]
    reporter: Reporter
    _done: int = field(default=0)

    def run(self, params: Any) -> Evaluation:
        self._done = 0
        env = make_environment(self.request.problem)
        policy = playable(self.planner, params, self.policy_hyperparams, self.request.seed)
        return evaluate(env, policy, self.request.episodes, self.request.seed, self._count)

    def _count(self) -> None:
        self._done += 1
        self.reporter.episode(self._done, self.request.episodes)


def _identity(request: PlanRequest, planner: MDPOPlanner) -> dict[str, Any]:
    noise, policy = type(planner.noise).__name__, type(planner.plan).__name__
    return {
        "domain": request.problem.domain_name,
        "instance": request.problem.instance_name,
        "label": request.problem.label,
        "horizon": request.problem.horizon,
        "config": request.config_name,
        "noise": _NOISE_NAMES.get(noise, noise),
        "noise_parameters": {
            name: value
            for name, value in request.config.section("Noise").items()
            if name != "method"
        },
        "policy": _POLICY_NAMES.get(policy, policy),
        "seed": request.seed,
        "episodes": request.episodes,
    }


def _figures(evaluation: Evaluation) -> dict[str, Any]:
    interval = evaluation.ci95
    return {
        "mean_return": _finite(evaluation.mean),
        "std_return": _finite(evaluation.std),
        "ci95": None if interval is None else [_finite(bound) for bound in interval],
        "returns": [_finite(value) for value in evaluation.returns.tolist()],
        "episode_lengths": evaluation.lengths.tolist(),
        "illegal_actions": evaluation.illegal_actions,
    }


def _finite(value: float) -> float | None:
    """None for what JSON has no number for."""
    return value if math.isfinite(value) else None


def _training_figures(planner: MDPOPlanner, result: TrainingResult) -> dict[str, Any]:
    return {
        "iterations": result.iterations,
        "best_iteration": result.best_iteration,
        "restarts": planner.parallel_updates,
        "batch": planner.batch_size_train,
        "status": result.status,
        "train_seconds": result.train_seconds,
        "compile_seconds": result.compile_seconds,
        "device": str(jax.devices()[0]),
        "versions": _versions(),
    }


def _versions() -> dict[str, str]:
    versions = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {"python": platform.python_version(), **versions}


def _title(summary: Mapping[str, Any]) -> str:
    return (
        f"{summary['label']} (H = {summary['horizon']}), {summary['policy']}, "
        f"{summary['noise']} noise, seed {summary['seed']}"
    )


def _require_same_problem(path: Path, saved: SavedPolicy, problem: Problem) -> None:
    here = problem_identity(problem)
    if saved.problem.get("digest") != here["digest"]:
        raise InputError(
            f"{path}: saved for {saved.problem.get('label')} "
            f"({saved.problem.get('domain')}/{saved.problem.get('instance')}), "
            f"not for {here['label']} ({here['domain']}/{here['instance']}) as its files are now"
        )


def _require_params(path: Path, planner: MDPOPlanner, saved: SavedPolicy) -> None:
    expected = planner.params_structure(saved.policy_hyperparams)
    wanted = jax.tree.map(lambda leaf: leaf.shape, expected)
    found = jax.tree.map(lambda leaf: leaf.shape, saved.params)
    if wanted != found:
        raise InputError(
            f"{path}: damaged policy file, or saved for another horizon: its tensors are "
            f"{found}, expected {wanted}"
        )
