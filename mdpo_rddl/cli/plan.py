"""`mdpo-plan`: plan an RDDL problem from its files."""

import argparse
import contextlib
import io
import json
import logging
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from mdpo_rddl.cli.display import ProgressBar, print_summary
from mdpo_rddl.cli.options import PLAIN_ONLY, TRAINING_ONLY, configure, plan_parser
from mdpo_rddl.cli.termination import TERMINATED, Terminated, raised_on_sigterm
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.jax_setup import (
    grammar_tables,
    keep_compiled_programs,
    keep_no_programs,
    leave_out_of_collections,
    use_all_cores,
)
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import DEFAULT_PRESET, PLAIN_PRESET, PRESETS
from mdpo_rddl.planner.config.presets.by_domain import METHODS, config_for_domain
from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.session.load import evaluate_saved
from mdpo_rddl.session.plan import plan
from mdpo_rddl.session.replan import replan
from mdpo_rddl.session.report.run_folder import free_name
from mdpo_rddl.session.requests import LoadRequest, PlanRequest

RUNS = Path("runs")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 2 for bad input, 130 after an interrupt, 143 after SIGTERM.
    """
    options = plan_parser().parse_args(arguments)
    leave_out_of_collections()
    logging.basicConfig(
        level=logging.ERROR if options.quiet else logging.WARNING,
        format="mdpo-plan: %(levelname)s: %(message)s",
    )
    programs = None
    if options.no_cache:
        keep_no_programs()
    else:
        programs = keep_compiled_programs()
    if (options.restarts or 1) > 1:
        use_all_cores()
    try:
        with raised_on_sigterm():
            summary, where = _run(options, programs)
    except InputError as error:
        print("mdpo-plan: error:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("mdpo-plan: interrupted, nothing was written", file=sys.stderr)
        return 130
    except Terminated:
        print("mdpo-plan: terminated, nothing was written", file=sys.stderr)
        return TERMINATED
    _show(options, summary, where)
    return 0


def _run(options: argparse.Namespace, programs: Path | None) -> tuple[dict[str, Any], Path | None]:
    if options.load is not None:
        for name in TRAINING_ONLY:
            if getattr(options, name) is not None:
                option = "--" + name.replace("_", "-")
                raise InputError(f"{option} does not go with --load, which trains nothing")
    with _silenced(options.quiet), ProgressBar(shown=not options.quiet) as bar:
        if options.load is None:
            request = _plan_request(options, programs)
            is_online = options.replan or str(options.config) == "replan"
            run = replan if is_online else plan
            return run(request, bar), request.out
        if options.replan:
            raise InputError("--replan does not go with --load, which plans nothing")
        load = LoadRequest(
            domain=options.domain,
            instance=options.instance,
            folder=options.load,
            episodes=options.episodes,
            seed=options.seed,
            horizon=options.horizon,
            out=options.out,
        )
        return evaluate_saved(load, bar), options.out


def _plan_request(options: argparse.Namespace, programs: Path | None) -> PlanRequest:
    tables = None if options.no_cache else grammar_tables()
    problem = load_problem(options.domain, options.instance, options.horizon, tables)
    if str(options.config) in METHODS:
        # as JaxPlan's third argument: the domain's own configuration
        config = config_for_domain(options.domain, problem.domain_name, str(options.config))
        name = config.source
    elif options.config is not None:
        name, config = str(options.config), PlannerConfig.from_file(options.config)
    else:
        name = _preset(options)
        config = PRESETS[name](problem.domain_name)
    config = configure(config, options)
    own_seed = config.section("Optimize").get("key") or 0
    seed = own_seed if options.seed is None else options.seed
    out = options.out or free_name(RUNS, f"{problem.label}-seed{seed}")
    return PlanRequest(problem, config, name, seed, options.episodes, out, programs)


def _preset(options: argparse.Namespace) -> str:
    """The preset that was asked for, or the one that the other options suppose."""
    given = [name for name in PLAIN_ONLY if getattr(options, name) not in (None, False)]
    if options.preset is None:
        return PLAIN_PRESET if given else DEFAULT_PRESET
    if options.preset == DEFAULT_PRESET and given:
        option = "--" + given[0].replace("_", "-")
        raise InputError(f"{option} does not go with --preset {DEFAULT_PRESET}, which chooses it")
    return str(options.preset)


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


def _show(options: argparse.Namespace, summary: dict[str, Any], where: Path | None) -> None:
    if not options.quiet:
        print_summary(Console(), summary, None if where is None else str(where))
    if options.json:
        print(json.dumps(summary, allow_nan=False))


if __name__ == "__main__":
    sys.exit(main())
