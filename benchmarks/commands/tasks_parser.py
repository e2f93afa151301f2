"""The options of the commands of `python -m benchmarks` that try planners on many tasks."""

from pathlib import Path
from typing import Any

from benchmarks.tasks.names import (
    ABLATION_TASKS,
    ANYTIME_SECONDS,
    ANYTIME_TASKS,
    HIDDEN_TASKS,
    PLANNERS,
    SHARING_TASKS,
)
from mdpo_rddl.cli.options import WHOLE, OneLineParser, natural, number, positive_int, shard


def default_folder(command: str, decision_seconds: float) -> Path:
    """The results folder of a command; with time at the decisions it has another one."""
    return Path("results") / (f"{command}_thinking" if decision_seconds else command)


def add_task_commands(commands: Any) -> list[OneLineParser]:
    """Adds the commands."""
    everywhere = commands.add_parser(
        "everywhere",
        help="one instance of every problem of rddlrepository, or of files, beside JaxPlan",
    )
    everywhere.add_argument("--planners", nargs="+", choices=PLANNERS, default=list(PLANNERS))
    everywhere.set_defaults(run="everywhere", out=Path("results/everywhere"))
    published = commands.add_parser("published", help="81 tasks with published returns")
    published.set_defaults(run="published")
    report = commands.add_parser(
        "published-report", help="the table and the picture of published, from its rows alone"
    )
    report.set_defaults(run="published-report", out=default_folder("published", 0.0))
    ippc2014 = commands.add_parser(
        "ippc2014", help="forty instances of the 2014 competition, beside PROST's returns there"
    )
    ippc2014.set_defaults(run="ippc2014")
    for command, name in ((published, "published"), (ippc2014, "ippc2014")):
        folder = default_folder(name, 1.0)
        command.add_argument(
            "--decision-seconds",
            type=number(at_least=0),
            default=0.0,
            help=f"of each decision; the default folder is then {folder} (default: 0)",
        )
    ablation = commands.add_parser(
        "ablation", help="the race without each arm that had a part in its policy"
    )
    ablation.add_argument(
        "--problems", nargs="+", metavar="NAME:INSTANCE", default=list(ABLATION_TASKS)
    )
    ablation.add_argument(
        "--arms",
        nargs="+",
        metavar="ARM",
        default=[],
        help="which are left out (default: each that had a part in the policy)",
    )
    ablation.set_defaults(run="ablation", out=Path("results/ablation"))
    sharing = commands.add_parser(
        "sharing", help="time for thinking at the decisions against as much for the preparation"
    )
    sharing.add_argument(
        "--problems", nargs="+", metavar="NAME:INSTANCE", default=list(SHARING_TASKS)
    )
    sharing.add_argument("--decision-seconds", type=number(above=0), default=0.2)
    sharing.add_argument(
        "--decided",
        type=natural,
        metavar="EPISODES",
        help="whose decisions' time the other preparation has, too (default: all that are played; "
        "0: only the choice is left out)",
    )
    sharing.set_defaults(run="sharing", out=Path("results/sharing"))
    thinking = commands.add_parser(
        "thinking", help="time for thinking at the decisions beside the same policy alone"
    )
    thinking.add_argument(
        "--problems",
        nargs="+",
        metavar="NAME:INSTANCE",
        default=list(HIDDEN_TASKS),
        help="(default: the third instance of each domain whose state is not observed)",
    )
    thinking.add_argument("--decision-seconds", type=number(above=0), default=0.2)
    thinking.set_defaults(run="thinking", out=Path("results/thinking_hidden"))
    for command, form in (
        (everywhere, "NAME[:INSTANCE]|DOMAIN:INSTANCE|FILE"),
        (published, "NAME"),
        (ippc2014, "NAME"),
    ):
        command.add_argument("--problems", nargs="+", metavar=form, help="(default: all)")
    for command, seconds, episodes in (
        (everywhere, 30.0, 20),
        (published, 60.0, 20),
        (ippc2014, 60.0, 20),
        (ablation, 60.0, 20),
        (sharing, 30.0, 10),
        (thinking, 60.0, 20),
    ):
        command.add_argument("--seconds", type=number(above=0), default=seconds)
        command.add_argument("--episodes", type=positive_int, default=episodes)
        command.add_argument("--seeds", type=positive_int, default=1)
        command.add_argument("--memory-gb", type=number(above=0), default=8.0)
        command.add_argument(
            "--shard",
            type=shard,
            default=WHOLE,
            metavar="I/N",
            help="measure every N-th task from the I-th, counted from 0; jobs may share a folder",
        )
    anytime = commands.add_parser("anytime", help="what more time to prepare is worth")
    anytime.add_argument(
        "--problems", nargs="+", metavar="NAME:INSTANCE", default=list(ANYTIME_TASKS)
    )
    anytime.add_argument(
        "--seconds", nargs="+", type=number(above=0), default=list(ANYTIME_SECONDS)
    )
    anytime.add_argument("--episodes", type=positive_int, default=50)
    anytime.add_argument("--seeds", type=positive_int, default=5)
    anytime.add_argument("--memory-gb", type=number(above=0), default=8.0)
    anytime.set_defaults(run="anytime", out=Path("results/anytime"))
    return [everywhere, published, report, ippc2014, ablation, sharing, thinking, anytime]
