"""Evaluate what an earlier session saved."""

import contextlib
import dataclasses
import logging
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.logs import kept_warnings
from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.policy.file import AnySaved, load_policy
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.problem.load import Problem, load_problem, make_environment
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed, warn_of
from mdpo_rddl.session.report.page.write import add_page
from mdpo_rddl.session.report.run_folder import POLICY, SUMMARY, RunFolder, write_json
from mdpo_rddl.session.report.summary import (
    identity,
    optimum_figures,
    policy_figures,
    return_figures,
    warn_of_unplayable,
)
from mdpo_rddl.session.requests import LoadRequest, Reporter, Terms

logger = logging.getLogger(__name__)


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
    saved = load_policy(path, request.folder)
    if "horizon" not in saved.problem:
        raise InputError(f"{path}: damaged policy file: it does not say its horizon")
    horizon = saved.problem["horizon"] if request.horizon is None else request.horizon
    problem = _problem(request, saved, horizon)
    seed = saved.seed if request.seed is None else request.seed

    with contextlib.ExitStack() as stack:
        folder = None if request.out is None else stack.enter_context(RunFolder(request.out))
        warnings = stack.enter_context(kept_warnings())
        warn_of(problem)
        reporter.stage("compiling")
        policy = restored(dataclasses.replace(saved, seed=seed), problem, str(path))
        reporter.stage("evaluating")
        terms = Terms(problem, seed, request.episodes)
        observed = None if folder is None else Observed(terms)
        # compiled now, no decision's time has that in it
        policy(0, make_environment(problem).reset(seed=0)[0])
        plain = Evaluator(terms, reporter).run(policy, observed)
        warn_of_unplayable(plain)
        figures = return_figures(plain)
        if request.decision_seconds > 0.0:
            # import JAX
            from mdpo_rddl.policy.lookahead.choice import longest_choice
            from mdpo_rddl.session.thinking import think

            seconds = request.decision_seconds
            times = seconds, longest_choice(seconds)
            figures = think(policy, plain, times, terms, reporter, observed)
        summary = {
            **identity(
                problem,
                policy_figures(policy),
                config_name=str(path),
                seed=seed,
                episodes=request.episodes,
            ),
            **figures,
            **({} if horizon != saved.problem["horizon"] else optimum_figures(policy)),
            "loaded_from": str(request.folder),
            "versions": package_versions(),
        }
        if folder is not None and observed is not None:
            summary |= {
                **observed.figures(figures["returns"]),
                "warnings": warnings,
                "command": request.command,
            }
            with folder.writing():
                write_json(folder.staging / SUMMARY, summary)
                observed.write(folder.staging)
            add_page(folder)
            folder.commit()
        if request.movie is not None:
            from mdpo_rddl.session.movie import draw_movie

            reporter.stage("drawing")
            draw_movie(request.movie, policy, problem, seed)
    return summary


def _problem(request: LoadRequest, saved: AnySaved, horizon: int) -> Problem:
    """The problem that is named, else the one that the folder knows."""
    if request.domain is not None:
        functions = request.functions
        return load_problem(request.domain, request.instance, horizon, functions=functions)
    if saved.source is None:
        raise InputError(
            f"{request.folder}: holds no RDDL: name its problem as well, as in "
            f"mdpo-plan DOMAIN INSTANCE --load {request.folder}"
        )
    source = dataclasses.replace(saved.source, horizon=horizon)
    return source.load(functions=request.functions)
