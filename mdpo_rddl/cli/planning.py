"""What `mdpo-plan` does once its options are parsed and its files are there."""

import argparse
import contextlib
import io
import json
import os
import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from mdpo_rddl.cli.configure import configure
from mdpo_rddl.cli.display import print_summary
from mdpo_rddl.cli.option_checks import preset_name, replans
from mdpo_rddl.errors import printable
from mdpo_rddl.machine.cache import grammar_tables
from mdpo_rddl.machine.jax_setup import (
    keep_compiled_programs,
    keep_no_programs,
    leave_out_of_collections,
    require_devices,
    use_all_cores,
)
from mdpo_rddl.planner.config.preset_names import DEFAULT_PRESET
from mdpo_rddl.policy.load import load_policy
from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.session.configuration import config_of_file, load_preset
from mdpo_rddl.session.load import evaluate_saved
from mdpo_rddl.session.plan import plan
from mdpo_rddl.session.progress_bar import ProgressBar
from mdpo_rddl.session.report.run_folder import free_name
from mdpo_rddl.session.requests import LoadRequest, PlanRequest

RUNS = Path("runs")


def run(
    options: argparse.Namespace, command: str | None = None
) -> tuple[dict[str, Any], Path | None]:
    """Plans, or evaluates what is saved.

    Args:
      options: what `mdpo_rddl.cli.options.plan_parser` parsed and `check_plan_options` checked.
      command: the line that was given.

    Returns:
      The summary, as `summary.json` holds it, and the run folder, if one was written.

    Raises:
      InputError: as the session does.
    """
    leave_out_of_collections()
    if options.movie is not None:
        # the visualizers draw with pyplot, which shall open no window in this process
        os.environ["MPLBACKEND"] = "Agg"
        from mdpo_rddl.session.movie import check_movie  # imports what draws

        check_movie(options.movie)
    traced_cache = None
    if options.no_cache:
        keep_no_programs()
    else:
        traced_cache = keep_compiled_programs()
    if (options.restarts or 1) > 1:
        use_all_cores()
    if _needs_jax(options):
        require_devices()
    with _silenced(options.quiet), ProgressBar(not options.quiet) as bar:
        if options.load is not None:
            return evaluate_saved(_load_request(options, command), bar), options.out
        request = replace(_plan_request(options, traced_cache), command=command)
        if not replans(options):
            return plan(request, bar), request.out
        from mdpo_rddl.session.replan import replan  # imports JAX

        return replan(request, bar), request.out


def _needs_jax(options: argparse.Namespace) -> bool:
    """Whether something is compiled in any case."""
    is_race = options.config is None and preset_name(options) == DEFAULT_PRESET
    return options.load is None and (replans(options) or not is_race)


def show(options: argparse.Namespace, summary: dict[str, Any], where: Path | None) -> None:
    """Prints a summary as the options ask."""
    if not options.quiet:
        print_summary(Console(), summary, None if where is None else printable(where))
    if options.json:
        print(json.dumps(summary, allow_nan=False))


def _load_request(options: argparse.Namespace, command: str | None) -> LoadRequest:
    return LoadRequest(
        domain=options.domain,
        instance=options.instance,
        folder=options.load,
        episodes=options.episodes,
        seed=options.seed,
        horizon=options.horizon,
        out=options.out,
        decision_seconds=options.decision_seconds,
        command=command,
        movie=options.movie,
        functions=options.functions,
    )


def _plan_request(options: argparse.Namespace, traced_cache: Path | None) -> PlanRequest:
    tables = None if options.no_cache else grammar_tables()
    problem = load_problem(
        options.domain, options.instance, options.horizon, tables, options.functions
    )
    if options.config is not None:
        name, config = config_of_file(options.config, options.domain, problem.domain_name)
    else:
        name = preset_name(options)
        config = load_preset(name, problem.domain_name)
    config = configure(config, options)
    own_seed = config.key
    seed = own_seed if options.seed is None else options.seed
    out = options.out or free_name(RUNS, f"{problem.label}-seed{seed}")
    options.out = out  # whoever is stopped is told where
    start = options.start_from
    return PlanRequest(
        problem,
        config,
        name,
        seed,
        options.episodes,
        out,
        traced_cache,
        decision_seconds=options.decision_seconds,
        movie=options.movie,
        start_from=None if start is None else load_policy(start, problem.functions),
        resume=options.resume,
        checkpoint_seconds=options.checkpoint_seconds,
    )


@contextlib.contextmanager
def _silenced(quiet: bool) -> Iterator[None]:
    """Keeps what the libraries print off standard output, which is the command's own.

    It follows on standard error, unless an error is all that is to be said there.
    """
    printed = io.StringIO()
    with warnings.catch_warnings(), contextlib.redirect_stdout(printed):
        warnings.simplefilter("ignore")
        yield
    if not quiet:
        sys.stderr.write(printed.getvalue())
