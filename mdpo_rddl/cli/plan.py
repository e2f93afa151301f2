"""`mdpo-plan`: plan an RDDL problem from its files."""

# PYTHON_ARGCOMPLETE_OK

import argparse
import logging
import shlex
import sys
from collections.abc import Sequence

import argcomplete

from mdpo_rddl.cli.options import check_plan_options, plan_parser
from mdpo_rddl.cli.termination import TERMINATED, Terminated, raised_on_sigterm
from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.files import list_problems, read_problem


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 2 for bad input, 130 after an interrupt, 143 after SIGTERM.
    """
    parser = plan_parser()
    argcomplete.autocomplete(parser)
    options = parser.parse_args(arguments)
    if options.list:
        print("\n".join(list_problems()))
        return 0
    logging.basicConfig(
        level=logging.ERROR if options.quiet else logging.WARNING,
        format="mdpo-plan: %(levelname)s: %(message)s",
    )
    try:
        with raised_on_sigterm():
            _check_quickly(options)
            # takes long to import, which what is wrong so far need not wait for
            from mdpo_rddl.cli import planning

            given = sys.argv[1:] if arguments is None else arguments
            summary, where = planning.run(options, shlex.join(["mdpo-plan", *given]))
    except InputError as error:
        print("mdpo-plan: error:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("mdpo-plan: interrupted, nothing was written", file=sys.stderr)
        return 130
    except Terminated:
        print("mdpo-plan: terminated, nothing was written", file=sys.stderr)
        return TERMINATED
    planning.show(options, summary, where)
    return 0


def _check_quickly(options: argparse.Namespace) -> None:
    """Raises `InputError` for what is wrong with the options or is not there."""
    check_plan_options(options)
    if options.load is not None and not options.load.is_dir():
        raise InputError(f"{options.load}: no such run folder")
    if options.start_from is not None and not options.start_from.exists():
        raise InputError(f"{options.start_from}: no such run folder")
    read_problem(options.domain, options.instance)


if __name__ == "__main__":
    sys.exit(main())
