"""`mdpo-ipc`: planners run and scored as in the 2023 planning competition."""

import argparse
import logging
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from rddlrepository import RDDLRepoManager

from mdpo_rddl.cli.executor_options import add_executor_options, executor_from, hardware
from mdpo_rddl.cli.ipc_display import LiveTable
from mdpo_rddl.cli.options import OneLineParser, number, positive_int, seed_int
from mdpo_rddl.cli.termination import TERMINATED, Terminated, raised_on_sigterm
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.conditions import keep_conditions
from mdpo_rddl.ipc.problems import COMPETITION, parse_problems
from mdpo_rddl.ipc.registry import PLANNERS, check_planner
from mdpo_rddl.ipc.report import write_report
from mdpo_rddl.ipc.results import load_result
from mdpo_rddl.ipc.rules import Entry, Rules
from mdpo_rddl.ipc.run import run
from mdpo_rddl.ipc.trial import OK
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.executors import LocalExecutor, SlurmExecutor

_SUFFIX = "_ippc2023"


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 1 if a trial of `agent` failed, 2 for bad input, 130 after an
      interrupt, 143 after SIGTERM.
    """
    options = _parser().parse_args(arguments)
    warnings.simplefilter("ignore")
    try:
        with raised_on_sigterm():
            return options.command(options)
    except InputError as error:
        print("mdpo-ipc: error:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("mdpo-ipc: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    except Terminated:
        print("mdpo-ipc: terminated; the same command goes on from here", file=sys.stderr)
        return TERMINATED


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="mdpo-ipc", description="Run and score planners as the 2023 competition did."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=OneLineParser)

    runs = commands.add_parser("run", help="play planners on problems")
    runs.add_argument(
        "--problems",
        metavar="NAME:FROM-TO,...",
        default=COMPETITION,
        help="of rddlrepository, or domain.rddl:instance.rddl (default: the competition's forty)",
    )
    runs.add_argument(
        "--planners",
        metavar="NAME,...",
        default=",".join(PLANNERS),
        help="or module:Class of your own (default: %(default)s)",
    )
    runs.add_argument("--trials", type=positive_int, default=Rules.trials)
    runs.add_argument("--out", metavar="DIR", type=Path, required=True, help="the run's folder")
    runs.add_argument("--quiet", action="store_true", help="no table while it runs")
    add_executor_options(runs)
    runs.set_defaults(command=_run)

    scores = commands.add_parser("score", help="score a run, finished or not")
    scores.add_argument("folder", metavar="DIR", type=Path, help="the run's folder")
    scores.set_defaults(command=_score)

    agent = commands.add_parser("agent", help="the entry interface of the competition")
    agent.add_argument("domain", help="HVAC, or any problem of rddlrepository, or a file")
    agent.add_argument("instance", help="its instance")
    agent.add_argument("method", help="the planner's name, or module:Class")
    agent.add_argument("episodes", type=positive_int, help="number of trials")
    agent.add_argument("--out", metavar="DIR", type=Path, default=Path("outputs"))
    agent.set_defaults(command=_agent)

    for command in (runs, agent):
        _add_rules(command)
    return parser


def _add_rules(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("rules")
    for option, default, text in (
        ("--plan-seconds", Rules.plan_seconds, "preparation of each instance"),
        ("--trial-seconds", Rules.trial_seconds, "each trial"),
        ("--memory-gb", Rules.memory_gb, "of a planner's process"),
    ):
        group.add_argument(
            option, type=number(above=0), default=default, help=f"{text} (default: {default:g})"
        )
    group.add_argument(
        "--lenient",
        action="store_true",
        help="go on after an action that breaks a precondition, and report both scores",
    )
    group.add_argument("--seed", type=seed_int, default=0)


def _rules(options: argparse.Namespace, trials: int) -> Rules:
    return Rules(
        trials=trials,
        plan_seconds=options.plan_seconds,
        trial_seconds=options.trial_seconds,
        memory_gb=options.memory_gb,
        lenient=options.lenient,
        seed=options.seed,
    )


def _run(options: argparse.Namespace) -> int:
    problems = parse_problems(options.problems)
    names = [name.strip() for name in options.planners.split(",") if name.strip()]
    if not names:
        raise InputError("--planners: there is no planner in it")
    for name in names:
        check_planner(name)
    rules = _rules(options, options.trials)
    executor = executor_from(options, options.out)
    if isinstance(executor, SlurmExecutor):
        _check_jobs(rules, executor)
    keep_conditions(options.out, rules, hardware(options))
    entries = [Entry(problem, name) for problem in problems for name in dict.fromkeys(names)]
    shown = not options.quiet and sys.stderr.isatty()
    level = logging.WARNING if shown or options.quiet else logging.INFO
    _log_to_stderr(level)
    with LiveTable(options.out, entries, rules, shown):
        run(options.out, entries, rules, executor)
    print(write_report(options.out), end="")
    return 0


def _check_jobs(rules: Rules, jobs: SlurmExecutor) -> None:
    """Raises `InputError` if a planner could not use up what the rules give it."""
    if jobs.memory_gb <= rules.memory_gb:
        raise InputError(
            f"jobs of {jobs.memory_gb:g} GB cannot hold planners of {rules.memory_gb:g} GB: set "
            "--slurm-memory-gb or --memory-gb"
        )
    if 60 * jobs.minutes - jobs.signal_seconds <= rules.plan_seconds:
        raise InputError(
            f"jobs of {jobs.minutes} minutes cannot hold a preparation of {rules.plan_seconds:g} "
            "s: set --slurm-minutes or --plan-seconds"
        )


def _score(options: argparse.Namespace) -> int:
    print(write_report(options.folder), end="")
    return 0


def _agent(options: argparse.Namespace) -> int:
    # rddlrepository's plain HVAC, for one, is another problem than the competition's
    is_short = options.domain + _SUFFIX in RDDLRepoManager().list_problems()
    domain = options.domain + _SUFFIX if is_short else options.domain
    (problem,) = parse_problems(f"{domain}:{options.instance}")
    check_planner(options.method)
    rules, entry = _rules(options, options.episodes), Entry(problem, options.method)
    keep_conditions(options.out, rules, {"executor": "local", "cores": usable_cores()})
    _log_to_stderr(logging.INFO)
    run(options.out, [entry], rules, LocalExecutor())
    result = load_result(options.out, entry, rules.trials)
    for trial in result.trials:
        end = "" if trial.status == OK else f" ({trial.status}: {trial.cause})"
        print(f"episode {trial.trial + 1} ended with return {trial.total}{end}")
    return int(len([trial for trial in result.trials if trial.status == OK]) < rules.trials)


def _log_to_stderr(level: int) -> None:
    logging.basicConfig(level=level, format="%(asctime)s %(message)s")
    logging.getLogger("jax").setLevel(logging.WARNING)


if __name__ == "__main__":
    sys.exit(main())
