"""Options that say where the work is done."""

import argparse
from pathlib import Path

from mdpo_rddl.executors import Executor, make_executor


def add_executor_options(group: argparse._ArgumentGroup) -> None:
    """Adds `--executor` and what goes with it."""
    group.add_argument(
        "--executor",
        choices=["local"],
        default="local",
        help="one after the other on this machine (default: %(default)s)",
    )


def executor_from(options: argparse.Namespace, out: Path) -> Executor:
    """The executor that was asked for.

    Args:
      options: what a parser with these options has parsed.
      out: the results folder; what the executor writes itself goes there.

    Raises:
      InputError: if it cannot be had here.
    """
    return make_executor(options.executor, {})
