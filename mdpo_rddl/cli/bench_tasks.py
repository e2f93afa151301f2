"""The commands of `mdpo-bench` that try planners on many tasks."""

import argparse
from pathlib import Path
from typing import Any

from mdpo_rddl.bench.tasks.everywhere import PLANNERS, everywhere_table, run_everywhere
from mdpo_rddl.bench.tasks.published import published_table, run_published
from mdpo_rddl.bench.tasks.trial import Conditions
from mdpo_rddl.cli.options import OneLineParser, number, positive_int
from mdpo_rddl.errors import InputError


def add_task_commands(commands: Any) -> list[OneLineParser]:
    """Adds `everywhere` and `published`."""
    everywhere = commands.add_parser(
        "everywhere", help="one instance of every problem of rddlrepository, beside JaxPlan"
    )
    everywhere.add_argument("--planners", nargs="+", choices=PLANNERS, default=list(PLANNERS))
    everywhere.set_defaults(run=_everywhere, out=Path("results/everywhere"))
    published = commands.add_parser("published", help="81 tasks with published returns")
    published.add_argument(
        "--shard", metavar="I/N", default="0/1", help="every N-th task, from the I-th on, from 0"
    )
    published.set_defaults(run=_published, out=Path("results/published"))
    for command, seconds, episodes in ((everywhere, 30.0, 20), (published, 60.0, 20)):
        command.add_argument("--problems", nargs="+", metavar="NAME", help="(default: all)")
        command.add_argument("--seconds", type=number(above=0), default=seconds)
        command.add_argument("--episodes", type=positive_int, default=episodes)
        command.add_argument("--seeds", type=positive_int, default=1)
        command.add_argument("--memory-gb", type=number(above=0), default=8.0)
    return [everywhere, published]


def _conditions(options: argparse.Namespace) -> Conditions:
    return Conditions(options.seconds, options.episodes, options.memory_gb)


def _everywhere(options: argparse.Namespace) -> str:
    records = run_everywhere(
        options.out, options.problems, options.planners, options.seeds, _conditions(options)
    )
    return everywhere_table(records)


def _published(options: argparse.Namespace) -> str:
    first, slash, count = options.shard.partition("/")
    if not (slash and first.isdecimal() and count.isdecimal() and int(first) < int(count)):
        raise InputError(f"--shard: must be I/N with 0 <= I < N, got {options.shard!r}")
    records = run_published(
        options.out,
        options.problems,
        options.seeds,
        _conditions(options),
        (int(first), int(count)),
    )
    return published_table(records)
