"""`mdpo-report`: the page of a run folder, or one that compares several."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from mdpo_rddl.cli.ending import ending_in_order, without_waiting
from mdpo_rddl.cli.importing import ended_at_once
from mdpo_rddl.cli.logs import show_log
from mdpo_rddl.cli.options import OneLineParser
from mdpo_rddl.errors import InputError, printable

_COMPARISON = Path("comparison.html")


def report_parser() -> OneLineParser:
    """The parser of `mdpo-report`."""
    parser = OneLineParser(
        prog="mdpo-report",
        description="Write report.html into a run folder, or one page that compares several runs.",
        epilog="Bad input ends with one line on standard error and status 2.",
    )
    parser.add_argument("runs", nargs="+", metavar="RUN", type=Path, help="run folder")
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        help=f"the page (default: report.html in the run folder; of several {_COMPARISON})",
    )
    return parser


@ending_in_order("mdpo-report")
def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 2 for bad input, 130 after an interrupt.
    """
    options = report_parser().parse_args(arguments)
    show_log(logging.WARNING, "mdpo-report: %(levelname)s: %(message)s")
    print(f"written to {printable(_write(options))}")
    return 0


def _write(options: argparse.Namespace) -> Path:
    """Writes the page, and says where."""
    for folder in options.runs:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such run folder")
    # takes long to import, which what is wrong so far need not wait for
    with ended_at_once():
        from mdpo_rddl.session.report.page.write import write_comparison, write_page

    if len(options.runs) == 1:
        return write_page(options.runs[0], options.out)
    return write_comparison(options.runs, options.out or _COMPARISON)


if __name__ == "__main__":
    sys.exit(without_waiting(main()))
