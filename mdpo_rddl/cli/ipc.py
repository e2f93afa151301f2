"""`mdpo-ipc`: planners run and scored as in the 2023 planning competition."""

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from mdpo_rddl.cli.ending import ending_in_order, without_waiting
from mdpo_rddl.cli.executor_options import add_executor_options
from mdpo_rddl.cli.importing import ended_at_once
from mdpo_rddl.cli.options import OneLineParser, number, positive_int, seed_int
from mdpo_rddl.cli.termination import exit_status, how_it_ended, stopped_in_two_steps
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.names import USUAL_NAMES, check_name
from mdpo_rddl.ipc.problems import COMPETITION, parse_problems
from mdpo_rddl.ipc.rules import Rules


@ending_in_order("mdpo-ipc")
def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 1 if a trial of `agent` failed, 2 for bad input, 130 after an
      interrupt, 143 after SIGTERM.
    """
    options = _parser().parse_args(arguments)
    warnings.simplefilter("ignore")
    try:
        with stopped_in_two_steps("mdpo-ipc"):
            _check_quickly(options)
            # takes long to import, which a mistake in the options need not wait for
            with ended_at_once():
                from mdpo_rddl.cli.ipc_commands import COMMANDS

            return COMMANDS[options.command](options)
    except KeyboardInterrupt as stop:
        how = how_it_ended(stop)
        print(f"mdpo-ipc: {how}; the same command goes on from here", file=sys.stderr)
        return exit_status(stop)


def _check_quickly(options: argparse.Namespace) -> None:
    """Reads the lists of `run`; raises `InputError` for a name that is not known."""
    if options.command != "run":
        return
    options.problems = parse_problems(options.problems)
    options.planners = [name.strip() for name in options.planners.split(",") if name.strip()]
    if not options.planners:
        raise InputError("--planners: there is no planner in it")
    for name in options.planners:
        check_name(name)


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
        default=",".join(USUAL_NAMES),
        help="or module:Class of your own (default: %(default)s)",
    )
    runs.add_argument(
        "--trials",
        type=positive_int,
        default=Rules.trials,
        help="on each instance (default: %(default)s)",
    )
    runs.add_argument("--out", metavar="DIR", type=Path, required=True, help="the run's folder")
    runs.add_argument("--quiet", action="store_true", help="no table while it runs")
    add_executor_options(runs)
    runs.set_defaults(command="run")

    scores = commands.add_parser("score", help="score a run, finished or not")
    scores.add_argument("folder", metavar="DIR", type=Path, help="the run's folder")
    scores.set_defaults(command="score")

    agent = commands.add_parser("agent", help="the entry interface of the competition")
    agent.add_argument("domain", help="HVAC, or any problem of rddlrepository, or a file")
    agent.add_argument("instance", help="its instance")
    agent.add_argument("method", help="the planner's name, or module:Class")
    agent.add_argument("episodes", type=positive_int, help="number of trials")
    agent.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("outputs"),
        help="where traces and returns go (default: %(default)s)",
    )
    agent.set_defaults(command="agent")

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
    group.add_argument(
        "--seed",
        type=seed_int,
        default=0,
        help="of the run; the environment's seed of each trial follows from it "
        "(default: %(default)s)",
    )


if __name__ == "__main__":
    sys.exit(without_waiting(main()))
