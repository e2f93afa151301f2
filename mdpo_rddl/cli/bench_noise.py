"""The command of `mdpo-bench` that measures what noise is worth."""

import argparse
from pathlib import Path
from typing import Any

from mdpo_rddl.bench.noise_value.methods import CONFIGURATIONS, METHODS, PLANS
from mdpo_rddl.bench.noise_value.problems import with_instances
from mdpo_rddl.bench.noise_value.report import write_report
from mdpo_rddl.bench.noise_value.run import Shard, all_cells, run_noise_value
from mdpo_rddl.cli.executor_options import add_executor_options, executor_from
from mdpo_rddl.cli.options import OneLineParser, positive_int
from mdpo_rddl.machine.jax_setup import keep_compiled_programs, use_all_cores


def add_noise_command(commands: Any) -> OneLineParser:
    """Adds `noise-value`; returns its parser."""
    command = commands.add_parser(
        "noise-value", help="rules for the noise against JaxPlan's planner, over many problems"
    )
    command.add_argument(
        "--problems",
        nargs="+",
        metavar="NAME",
        help="of rddlrepository, or NAME:INSTANCE (default: all; the first instance, of the 2023 "
        "competition all five)",
    )
    command.add_argument("--plans", nargs="+", choices=PLANS, default=list(PLANS))
    command.add_argument(
        "--configurations",
        nargs="+",
        choices=CONFIGURATIONS,
        default=list(CONFIGURATIONS),
        help="JaxPlan's own for the problem, else its default; the same without PGPE",
    )
    command.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    command.add_argument("--seeds", type=positive_int, default=5)
    command.add_argument("--iterations", type=positive_int, default=1000)
    command.add_argument(
        "--max-horizon", type=positive_int, default=40, help="cuts a longer one (default: 40)"
    )
    command.add_argument("--rollouts", type=positive_int, default=64, help="of each best iterate")
    command.add_argument(
        "--shard",
        type=_shard,
        default=Shard(),
        metavar="I/N",
        help="measure every N-th cell from the I-th, for machines that share a folder",
    )
    add_executor_options(command)
    command.set_defaults(run=_noise_value, out=Path("results/noise_value"))
    return command


def _shard(text: str) -> Shard:
    index, _, count = text.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise argparse.ArgumentTypeError(f"must be I/N with 1 <= I <= N, got {text!r}")
    return Shard(int(index), int(count))


def _noise_value(options: argparse.Namespace) -> str:
    use_all_cores()
    keep_compiled_programs()
    cells = all_cells(
        with_instances(options.problems),
        options.plans,
        options.configurations,
        options.methods,
        out=options.out,
        seeds=options.seeds,
        iterations=options.iterations,
        max_horizon=options.max_horizon,
        rollouts=options.rollouts,
    )
    run_noise_value(cells, executor_from(options, options.out), options.shard)
    return write_report(options.out)
