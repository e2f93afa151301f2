"""The options of those commands of `python -m benchmarks` that reproduce the paper."""

from pathlib import Path
from typing import Any

from benchmarks.common.names import SETTINGS
from benchmarks.paper.names import FACTORS, METHODS, SENSITIVITY_SETTINGS
from mdpo_rddl.cli.executor_options import add_executor_options
from mdpo_rddl.cli.options import OneLineParser, positive_int


def add_paper_commands(commands: Any) -> list[OneLineParser]:
    """Adds the commands; returns those that take `--out`."""
    paper = commands.add_parser("paper", help="the paper's Table 1 and figures")
    paper.add_argument("--settings", nargs="+", choices=list(SETTINGS), default=list(SETTINGS))
    paper.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    _add_size(paper, seeds=20)
    paper.add_argument(
        "--episodes",
        type=positive_int,
        default=5,
        help="of each seed's last iterate, on the exact numpy environment (default: %(default)s)",
    )
    add_executor_options(paper)
    paper.set_defaults(run="paper", out=Path("results/paper"))

    report = commands.add_parser("report", help="the paper's table and figures from files alone")
    report.add_argument("out", metavar="DIR", type=Path, help="a folder that `paper` has written")
    report.set_defaults(run="report")

    choices = commands.add_parser(
        "paper-sensitivity", help="adaptive noise with one choice changed at a time"
    )
    choices.add_argument(
        "--settings", nargs="+", choices=list(SETTINGS), default=list(SENSITIVITY_SETTINGS)
    )
    factors = list(FACTORS)
    choices.add_argument("--factors", nargs="+", choices=factors, default=factors)
    _add_size(choices, seeds=5)
    choices.set_defaults(run="paper-sensitivity", out=Path("results/paper/sensitivity"))

    theorem = commands.add_parser(
        "theorem", help="the reparameterised gradient against finite differences"
    )
    theorem.add_argument(
        "--batches", type=positive_int, default=400, help="of 200 rollouts (default: %(default)s)"
    )
    theorem.set_defaults(run="theorem", out=Path("results/paper/theorem"))
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
