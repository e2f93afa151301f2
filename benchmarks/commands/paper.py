"""What those commands of `python -m benchmarks` do that reproduce the paper."""

import argparse

from benchmarks.paper import sensitivity
from benchmarks.paper.cells import PaperSize
from benchmarks.paper.landscape import run_landscape
from benchmarks.paper.report import write_report
from benchmarks.paper.runner import run_paper
from benchmarks.paper.theorem import run_theorem, theorem_table
from mdpo_rddl.cli.executor_options import executor_from
from mdpo_rddl.machine.jax_setup import keep_compiled_programs, use_all_cores


def _paper(options: argparse.Namespace) -> str:
    _use_the_machine()
    run_paper(
        options.out,
        options.settings,
        options.methods,
        PaperSize(options.seeds, options.iterations, options.episodes, options.rollouts),
        executor_from(options, options.out),
    )
    run_landscape(options.out)
    return write_report(options.out)


def _report(options: argparse.Namespace) -> str:
    return write_report(options.out)


def _sensitivity(options: argparse.Namespace) -> str:
    _use_the_machine()
    records = sensitivity.run_sensitivity(
        options.out,
        options.settings,
        options.factors,
        options.seeds,
        options.iterations,
        options.rollouts,
    )
    return sensitivity.sensitivity_table(records)


def _theorem(options: argparse.Namespace) -> str:
    _use_the_machine()
    return theorem_table(run_theorem(options.out, options.batches))


def _use_the_machine() -> None:
    use_all_cores()
    keep_compiled_programs()


PAPER_COMMANDS = {
    "paper": _paper,
    "report": _report,
    "paper-sensitivity": _sensitivity,
    "theorem": _theorem,
}
"""By the commands' names."""
