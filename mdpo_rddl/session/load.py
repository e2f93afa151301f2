"""Evaluate what an earlier session saved."""

import contextlib
from pathlib import Path
from typing import Any

import jax

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.policy.file import SavedPolicy, load_policy, problem_identity
from mdpo_rddl.problem.load import Problem, load_problem
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.report.run_folder import POLICY, SUMMARY, RunFolder, write_json
from mdpo_rddl.session.report.summary import identity, return_figures
from mdpo_rddl.session.requests import LoadRequest, PlanRequest, Reporter


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
        planner = build_planner(problem, config).planner
        _require_params(path, planner, saved)
        played = PlanRequest(
            problem, config, str(path), seed, request.episodes, request.out or request.folder
        )
        reporter.stage("evaluating")
        evaluator = Evaluator(played, planner, saved.policy_hyperparams, reporter)
        summary = {
            **identity(played, planner),
            **return_figures(evaluator.run(saved.params)),
            "loaded_from": str(request.folder),
            "versions": package_versions(),
        }
        if folder is not None:
            with folder.writing():
                write_json(folder.staging / SUMMARY, summary)
            folder.commit()
    return summary


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
