"""The commands of `mdpo-bench` that reproduce the paper."""

import argparse
from pathlib import Path
from typing import Any

from mdpo_rddl.bench.common.settings import DOMAIN_FILES
from mdpo_rddl.bench.paper import sensitivity
from mdpo_rddl.bench.paper.landscape import run_landscape
from mdpo_rddl.bench.paper.methods import METHODS
from mdpo_rddl.bench.paper.report import write_report
from mdpo_rddl.bench.paper.runner import run_paper
from mdpo_rddl.bench.paper.theorem import run_theorem, theorem_table
from mdpo_rddl.cli.executor_options import add_executor_options, executor_from
from mdpo_rddl.cli.options import OneLineParser, positive_int
from mdpo_rddl.machine.jax_setup import keep_compiled_programs, use_all_cores


def add_paper_commands(commands: Any) -> list[OneLineParser]:
    """Adds the commands; returns those that take `--out`."""
    paper = commands.add_parser("paper", help="the paper's Table 1 and figures")
    paper.add_argument(
        "--settings", nargs="+", choices=list(DOMAIN_FILES), default=list(DOMAIN_FILES)
    )
    paper.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    _add_size(paper, seeds=20)
    paper.add_argument(
        "--episodes",
        type=positive_int,
        default=5,
        help="of each seed's last iterate, on the exact numpy environment (default: %(default)s)",
    )
    add_executor_options(paper)
    paper.set_defaults(run=_paper, out=Path("results/paper"))

    report = commands.add_parser("report", help="the paper's table and figures from files alone")
    report.add_argument("out", metavar="DIR", type=Path, help="a folder that `paper` has written")
    report.set_defaults(run=_report)

    choices = commands.add_parser(
        "paper-sensitivity", help="adaptive noise with one choice changed at a time"
    )
    choices.add_argument(
        "--settings", nargs="+", choices=list(DOMAIN_FILES), default=list(sensitivity.SETTINGS)
    )
    factors = list(sensitivity.FACTORS)
    choices.add_argument("--factors", nargs="+", choices=factors, default=factors)
    _add_size(choices, seeds=5)
    choices.set_defaults(run=_sensitivity, out=Path("results/paper/sensitivity"))

    theorem = commands.add_parser(
        "theorem", help="the reparameterised gradient against finite differences"
    )
    theorem.add_argument(
        "--batches", type=positive_int, default=400, help="of 200 rollouts (default: %(default)s)"
    )
    theorem.set_defaults(run=_theorem, out=Path("results/paper/theorem"))
    return [paper, choices, theorem]


def _add_size(command: OneLineParser, seeds: int) -> None:
    command.add_argument("--seeds", type=positive_int, default=seeds)
    command.add_argument("--iterations", type=positive_int, default=3000)
    command.add_argument(
        "--rollouts",
        type=positive_int,
        default=20,
        help="of each evaluated iterate, on the exact compiled model (default: %(default)s)",
    )


def _paper(options: argparse.Namespace) -> str:
    _use_the_machine()
    run_paper(
        options.out,
        options.settings,
        options.methods,
        options.seeds,
        options.iterations,
        options.rollouts,
        options.episodes,
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
