"""`python -m benchmarks`: the measurements that the project reports."""

import logging
import sys
import warnings
from collections.abc import Sequence

from benchmarks.commands.parser import bench_parser
from benchmarks.commands.tasks_parser import default_folder
from mdpo_rddl.cli.ending import ending_in_order, without_waiting
from mdpo_rddl.cli.importing import ended_at_once
from mdpo_rddl.cli.logs import show_log
from mdpo_rddl.cli.markdown import print_markdown
from mdpo_rddl.cli.results_lock import results_lock
from mdpo_rddl.cli.termination import exit_status, how_it_ended, stopped_in_two_steps
from mdpo_rddl.machine.files import write_atomically


@ending_in_order("benchmarks")
def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 2 for bad input, 130 after an interrupt, 143 after SIGTERM.
    """
    options = bench_parser().parse_args(arguments)
    show_log(logging.INFO, "%(asctime)s %(message)s")
    logging.getLogger("jax").setLevel(logging.WARNING)
    warnings.simplefilter("ignore")
    try:
        with stopped_in_two_steps("benchmarks"):
            # takes long to import, which a mistake in the options need not wait for
            with ended_at_once():
                from benchmarks.commands.commands import COMMANDS

            if options.out is None:
                options.out = default_folder(options.run, options.decision_seconds)
            with results_lock(options):
                table = COMMANDS[options.run](options)
                write_atomically(options.out / "table.md", table)
    except KeyboardInterrupt as stop:
        how = how_it_ended(stop)
        print(f"benchmarks: {how}; the same command goes on from here", file=sys.stderr)
        return exit_status(stop)
    print_markdown(table)
    return 0


if __name__ == "__main__":
    sys.exit(without_waiting(main()))
