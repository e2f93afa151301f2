"""`mdpo-plan`: plan an RDDL problem from its files."""

# PYTHON_ARGCOMPLETE_OK

import argparse
import contextlib
import logging
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import argcomplete

from mdpo_rddl.cli.ending import ending_in_order, without_waiting
from mdpo_rddl.cli.importing import ended_at_once
from mdpo_rddl.cli.logs import show_log
from mdpo_rddl.cli.option_checks import check_plan_options
from mdpo_rddl.cli.options import plan_parser
from mdpo_rddl.cli.termination import exit_status, how_it_ended, stopped_in_two_steps
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.memory import watched_memory
from mdpo_rddl.problem.files import list_problems, read_problem
from mdpo_rddl.session.unfinished import UNFINISHED


@ending_in_order("mdpo-plan")
def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 2 for bad input, 130 after an interrupt, 143 after SIGTERM.
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    parser = plan_parser()
    argcomplete.autocomplete(parser)
    options = parser.parse_args(given)
    if options.list:
        print("\n".join(list_problems()))
        return 0
    level = logging.ERROR if options.quiet else logging.WARNING
    show_log(level, "mdpo-plan: %(levelname)s: %(message)s")
    try:
        with stopped_in_two_steps("mdpo-plan") as stop, _bounded(options.memory_gb):
            _check_quickly(options)
            # takes long to import, which what is wrong so far need not wait for
            with ended_at_once():
                from mdpo_rddl.cli import planning

            command = shlex.join(["mdpo-plan", *given])
            summary, where = planning.run(options, command)
    except KeyboardInterrupt as error:
        left = _how_to_go_on(given, options.out) or "nothing was written"
        print(f"mdpo-plan: {how_it_ended(error)}, {left}", file=sys.stderr)
        return exit_status(error)
    planning.show(options, summary, where)
    if summary.get("status") == "interrupted":
        told = ["stopped early", _how_to_go_on(given, where)]
    elif stop.is_wanted:
        told = ["stopped after the run was done" + (f": {where}" if where else "")]
    else:
        return 0
    print("mdpo-plan:", ", ".join(filter(None, told)), file=sys.stderr)
    return stop.status


@contextlib.contextmanager
def _bounded(gigabytes: float | None) -> Iterator[None]:
    """Ends the process in the block if it holds more memory than that."""

    def end(resident: float) -> NoReturn:
        text = f"{resident / 1e9:.1f} GB of memory, over --memory-gb {gigabytes:g}"
        os.write(2, f"\nmdpo-plan: error: {text}; what was kept before stays\n".encode())
        os._exit(2)

    if gigabytes is None:
        yield
        return
    with watched_memory(gigabytes * 1e9, end):
        yield


def _how_to_go_on(given: Sequence[str], out: Path | None) -> str:
    """The command that does; empty if there is nothing to go on with."""
    if out is None or not (out.parent / f"{out.name}{UNFINISHED}").is_dir():
        return ""
    command = ["mdpo-plan", *given]
    if "--resume" not in command:
        command += ["--resume"] if _names_out(given) else ["--out", str(out), "--resume"]
    return f"go on with: {shlex.join(command)}"


def _names_out(given: Sequence[str]) -> bool:
    return any(word == "--out" or word.startswith("--out=") for word in given)


def _check_quickly(options: argparse.Namespace) -> None:
    """Raises `InputError` for what is wrong with the options or is not there."""
    check_plan_options(options)
    if options.load is not None and not options.load.is_dir():
        raise InputError(f"{options.load}: no such run folder")
    if options.start_from is not None and not options.start_from.exists():
        raise InputError(f"{options.start_from}: no such run folder")
    if options.domain is not None:
        read_problem(options.domain, options.instance)


if __name__ == "__main__":
    sys.exit(without_waiting(main()))
