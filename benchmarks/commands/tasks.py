"""The commands of `python -m benchmarks` that try planners on many tasks."""

import argparse
from typing import Any

from benchmarks.tasks.ablation import ablation_table, run_ablation
from benchmarks.tasks.anytime import anytime_table, read_anytime, run_anytime
from benchmarks.tasks.anytime_figure import draw_anytime
from benchmarks.tasks.everywhere import everywhere_table, run_everywhere
from benchmarks.tasks.everywhere_figure import draw_everywhere
from benchmarks.tasks.ippc2014 import ippc2014_table, run_ippc2014
from benchmarks.tasks.naming import named_task
from benchmarks.tasks.published import read_published, run_published
from benchmarks.tasks.published_figure import draw_published
from benchmarks.tasks.published_table import published_table
from benchmarks.tasks.sharing import read_sharing, run_sharing, sharing_table
from benchmarks.tasks.thinking import run_thinking, thinking_table
from benchmarks.tasks.trial import Conditions

EVERYWHERE_PICTURE = "everywhere.png"
PUBLISHED_PICTURE = "published.png"
ANYTIME_PICTURE = "anytime.png"


def _conditions(options: argparse.Namespace) -> Conditions:
    return Conditions(
        options.seconds,
        options.episodes,
        options.memory_gb,
        getattr(options, "decision_seconds", 0.0),
    )


def _everywhere(options: argparse.Namespace) -> str:
    records = run_everywhere(
        options.out,
        options.problems,
        options.planners,
        options.seeds,
        _conditions(options),
        options.shard,
    )
    draw_everywhere(options.out / EVERYWHERE_PICTURE, records)
    return everywhere_table(records)


def _asked(options: argparse.Namespace) -> tuple[Any, ...]:
    """Which problems are to be measured, how, and where to."""
    what = options.out, options.problems, options.seeds
    return *what, _conditions(options), options.shard


def _published(options: argparse.Namespace) -> str:
    records = run_published(*_asked(options))
    draw_published(options.out / PUBLISHED_PICTURE, records)
    return published_table(records)


def _published_report(options: argparse.Namespace) -> str:
    records = read_published(options.out / "rows.csv")
    draw_published(options.out / PUBLISHED_PICTURE, records)
    return published_table(records)


def _ippc2014(options: argparse.Namespace) -> str:
    return ippc2014_table(run_ippc2014(*_asked(options)))


def _anytime(options: argparse.Namespace) -> str:
    times = [
        Conditions(seconds, options.episodes, options.memory_gb) for seconds in options.seconds
    ]
    run_anytime(options.out, [*map(named_task, options.problems)], options.seeds, times)
    returns = read_anytime(options.out)
    draw_anytime(options.out / ANYTIME_PICTURE, returns)
    return anytime_table(returns)


def _ablation(options: argparse.Namespace) -> str:
    tasks = [*map(named_task, options.problems)]
    records = run_ablation(
        options.out, tasks, options.seeds, _conditions(options), options.shard, options.arms
    )
    return ablation_table(records)


def _sharing(options: argparse.Namespace) -> str:
    tasks = [*map(named_task, options.problems)]
    shard, decided = options.shard, options.decided
    run_sharing(options.out, tasks, options.seeds, _conditions(options), shard, decided)
    return sharing_table(read_sharing(options.out))


def _thinking(options: argparse.Namespace) -> str:
    tasks = [*map(named_task, options.problems)]
    records = run_thinking(options.out, tasks, options.seeds, _conditions(options), options.shard)
    return thinking_table(records)


TASK_COMMANDS = {
    "ablation": _ablation,
    "anytime": _anytime,
    "everywhere": _everywhere,
    "ippc2014": _ippc2014,
    "published": _published,
    "published-report": _published_report,
    "sharing": _sharing,
    "thinking": _thinking,
}
"""By the commands' names."""
