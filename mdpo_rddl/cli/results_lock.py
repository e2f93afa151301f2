"""Which commands have their results folder for themselves."""

import argparse
import contextlib

from mdpo_rddl.cli.options import WHOLE
from mdpo_rddl.machine.locks import locked_results


def results_lock(options: argparse.Namespace) -> contextlib.AbstractContextManager[None]:
    """The lock of `options.out`; none where processes share the folder or only read from it.

    They share it where jobs of Slurm or the other shards write into it. What only reports may look
    at a run that goes on.
    """
    is_shared = getattr(options, "executor", None) == "slurm"
    is_shared |= getattr(options, "shard", WHOLE) != WHOLE
    only_reports = getattr(options, "report", False)
    only_reports |= getattr(options, "run", "").split("-")[-1] == "report"
    return contextlib.nullcontext() if is_shared or only_reports else locked_results(options.out)
