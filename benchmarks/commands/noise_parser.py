"""The options of the command of `python -m benchmarks` that measures what noise is worth."""

import math
from pathlib import Path
from typing import Any

from benchmarks.noise_value.names import CONFIGURATIONS, DEFAULT_SIGMA, NOISE_VALUE_PLANS
from mdpo_rddl.cli.executor_options import add_executor_options
from mdpo_rddl.cli.options import WHOLE, OneLineParser, number, positive_int, shard


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
    command.add_argument(
        "--plans", nargs="+", choices=NOISE_VALUE_PLANS, default=list(NOISE_VALUE_PLANS)
    )
    command.add_argument(
        "--configurations",
        nargs="+",
        choices=CONFIGURATIONS,
        default=list(CONFIGURATIONS),
        help="JaxPlan's own for the problem, else its default; the same without PGPE",
    )
    command.add_argument("--seeds", type=positive_int, default=5)
    command.add_argument("--iterations", type=positive_int, default=280)
    command.add_argument(
        "--max-horizon", type=positive_int, default=30, help="cuts a longer one (default: 30)"
    )
    command.add_argument("--rollouts", type=positive_int, default=64, help="of each best iterate")
    command.add_argument(
        "--most-seconds",
        type=number(above=0.0),
        default=math.inf,
        metavar="SECONDS",
        help="leave out what has trainings of more CPU time, as their first iterations foresee it",
    )
    command.add_argument(
        "--sigma",
        type=number(above=0.0),
        default=DEFAULT_SIGMA,
        help="of constant and adaptive noise, as a share of the action's range (default: "
        "%(default)s); another one needs another --out",
    )
    command.add_argument(
        "--shard",
        type=shard,
        default=WHOLE,
        metavar="I/N",
        help="measure every N-th cell from the I-th, counted from 0, for machines that share a "
        "folder",
    )
    what = command.add_mutually_exclusive_group()
    what.add_argument(
        "--cost", action="store_true", help="measure CPU times instead, here and in turn"
    )
    what.add_argument("--report", action="store_true", help="only report what there is")
    add_executor_options(command)
    command.set_defaults(run="noise-value", out=Path("results/noise_value"))
    return command
