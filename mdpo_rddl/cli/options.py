"""Options of the commands, and what is wrong with them by themselves.

Nothing here imports JAX, pyRDDLGym or matplotlib: a mistake in an option is said at once.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from mdpo_rddl import __version__
from mdpo_rddl.machine.cache import cache_folder, clear_cache
from mdpo_rddl.planner.config.preset_names import PRESET_NAMES
from mdpo_rddl.problem.files import problem_names


class OneLineParser(argparse.ArgumentParser):
    """A parser whose complaint is one line on standard error, with exit status 2."""

    def __init__(self, **arguments: Any) -> None:
        # an abbreviation that is unique today is ambiguous, or another option, tomorrow
        super().__init__(**{"allow_abbrev": False, **arguments})

    def error(self, message: str) -> NoReturn:
        """Prints the complaint and exits."""
        message = " ".join(message.split())
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


class _ClearCache(argparse.Action):
    """Clears the cache and ends the command, whatever else is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        folder = cache_folder()
        removed = clear_cache(folder)
        size = f"{removed.bytes / 1e6:,.1f} MB"
        print(f"{folder}: {removed.files:,} files removed, {size}")
        parser.exit(0)


def positive_int(text: str) -> int:
    """An integer of at least 1."""
    value = int(text) if text.isascii() and text.isdecimal() else 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be a positive integer, got {text!r}")
    return value


def natural(text: str) -> int:
    """An integer of at least 0."""
    if not (text.isascii() and text.isdecimal()):
        raise argparse.ArgumentTypeError(f"must be an integer of at least 0, got {text!r}")
    return int(text)


def seed_int(text: str) -> int:
    """An integer from 0 to 2**31 - 1, which every generator accepts."""
    value = int(text) if text.isascii() and text.isdecimal() else -1
    if not 0 <= value < 2**31:
        raise argparse.ArgumentTypeError(f"must be an integer from 0 to {2**31 - 1}, got {text!r}")
    return value


WHOLE = (0, 1)
"""All of the work, as the one shard of 1."""


def shard(text: str) -> tuple[int, int]:
    """I and N of "I/N": every N-th part of the work, from the I-th, counted from 0."""
    index, _, count = text.partition("/")
    if not (index.isdecimal() and count.isdecimal() and int(index) < int(count)):
        raise argparse.ArgumentTypeError(f"must be I/N with 0 <= I < N, got {text!r}")
    return int(index), int(count)


def number(
    *, at_least: float | None = None, above: float | None = None, at_most: float | None = None
) -> Callable[[str], float]:
    """A type for finite numbers within limits."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        limits = []
        if at_least is not None:
            limits.append((value >= at_least, f"at least {at_least:g}"))
        if above is not None:
            limits.append((value > above, f"above {above:g}"))
        if at_most is not None:
            limits.append((value <= at_most, f"at most {at_most:g}"))
        if not math.isfinite(value) or not all(held for held, _ in limits):
            wanted = " and ".join(name for _, name in limits) or "finite"
            raise argparse.ArgumentTypeError(f"must be a number {wanted}, got {text!r}")
        return value

    return parse


def plan_parser() -> OneLineParser:
    """The parser of `mdpo-plan`."""
    parser = OneLineParser(
        prog="mdpo-plan",
        description="Plan an RDDL problem by a race of methods (dynamic programming, searches, "
        "gradients with noise on the actions), and evaluate the policy on the exact environment.",
        epilog="Bad input ends with one line on standard error and status 2.",
    )
    domain = parser.add_argument(
        "domain",
        nargs="?",
        help="domain file, or a problem's name: one that comes with the package, such as hvac10, "
        "or one of rddlrepository",
    )
    domain.completer = _complete_problem  # type: ignore[attr-defined]
    parser.add_argument(
        "instance",
        nargs="?",
        help="instance file, unless the domain's has the instance, too; or an instance of "
        "rddlrepository's problem",
    )
    parser.add_argument(
        "--list", action="store_true", help="print the names of all problems, and stop"
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--preset",
        choices=PRESET_NAMES,
        help="defaults to start from (default: auto; paper with an option for the noise, or with "
        "--policy, --weight, --iterations, --batch, --restarts, --replan or --lookahead)",
    )
    source.add_argument(
        "--config",
        metavar="FILE|drp|slp|replan",
        type=Path,
        help="a JaxPlan .cfg, with an optional [Noise]; or the one for the domain and this plan: "
        "ours, else JaxPlan's own, else JaxPlan's default",
    )
    source.add_argument(
        "--load",
        metavar="DIR",
        type=Path,
        help="evaluate the policy saved in this run folder instead of training; the folder knows "
        "its problem",
    )
    parser.add_argument(
        "--functions",
        metavar="FILE.py",
        type=Path,
        help="the file of the Python functions that the domain calls as $name[...]; it is run",
    )
    parser.add_argument(
        "--start-from",
        metavar="RUN",
        type=Path,
        help="begin with the policy of this run folder: of the same problem, or of another "
        "instance of the domain, whose shared rule is carried over (preset auto)",
    )
    _add_noise_options(parser.add_argument_group("noise on the actions"))
    _add_training_options(parser.add_argument_group("training"))
    run = parser.add_argument_group("the run")
    run.add_argument(
        "--replan",
        action="store_true",
        help="plan anew at every decision of the evaluation, with --seconds (default: 1) and "
        "--iterations for each",
    )
    run.add_argument(
        "--lookahead",
        type=positive_int,
        help="steps that a plan looks ahead (default: the horizon, or the --config file's)",
    )
    run.add_argument(
        "--decision-seconds",
        type=number(at_least=0),
        default=0.0,
        help="time to improve the prepared policy at each decision of the evaluation, where that "
        "pays (default: 0, the policy as it is)",
    )
    run.add_argument("--horizon", type=positive_int, help="replaces the instance's horizon")
    run.add_argument(
        "--seed",
        type=seed_int,
        help="of training and evaluation (default: the configuration's key, 0 in the presets; "
        "with --load, its run's)",
    )
    run.add_argument(
        "--episodes",
        type=positive_int,
        default=20,
        help="evaluation episodes on the exact environment (default: %(default)s)",
    )
    run.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="run folder; an earlier run there is replaced (default: a new one under runs/)",
    )
    run.add_argument(
        "--movie",
        metavar="FILE.gif|mp4",
        type=Path,
        help="the evaluation's first episode, drawn by the domain's visualizer or as charts",
    )
    run.add_argument(
        "--resume",
        action="store_true",
        help="go on where a run into --out was stopped, from its last checkpoint",
    )
    run.add_argument(
        "--checkpoint-seconds",
        type=number(above=0),
        default=60.0,
        help="time from one checkpoint to the next (default: %(default)g)",
    )
    run.add_argument(
        "--memory-gb",
        type=number(above=0),
        help="end the run once it and what it has started hold more, in 1e9 bytes (default: no "
        "bound)",
    )
    run.add_argument(
        "--json", action="store_true", help="the summary as one JSON line, last on standard output"
    )
    run.add_argument(
        "--no-cache",
        action="store_true",
        help="compile everything anew, and keep nothing of it for the next run",
    )
    run.add_argument(
        "--clear-cache",
        action=_ClearCache,
        nargs=0,
        help="remove all programs that are kept for the next runs, and do no more",
    )
    run.add_argument("--quiet", action="store_true", help="no table, no progress and no warnings")
    return parser


def _complete_problem(**_: Any) -> list[str]:
    """What a shell offers for the first argument."""
    return problem_names()


def _add_noise_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--noise",
        choices=["adaptive", "constant", "none"],
        help="its rule (default: adaptive; with --config the file's, else constant beside updates "
        "without noise)",
    )
    group.add_argument(
        "--sigma",
        type=number(at_least=0),
        help="constant: standard deviation, in action units (default: 1); with a --config that has "
        "no [Noise], a share of the action's range (default: 0.1)",
    )
    group.add_argument(
        "--sigma-min",
        type=number(at_least=0),
        help="adaptive: at the least sensitive steps (default: 0)",
    )
    group.add_argument(
        "--sigma-max",
        type=number(at_least=0),
        help="adaptive: at the most sensitive steps (default: by domain, else 10; with a --config "
        "that has no [Noise] 0.1 of the action's range)",
    )
    group.add_argument(
        "--alpha",
        type=number(above=0),
        help="adaptive: shape of the map (default: by domain, else 1; with a --config that has no "
        "[Noise] 1)",
    )
    group.add_argument(
        "--quantile",
        type=number(above=0, at_most=1),
        help="adaptive: quantile of the sensitivities that counts as most sensitive "
        "(default: 0.95)",
    )


def _add_training_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--policy",
        choices=["drp", "slp"],
        help="deep reactive policy or straight-line plan (default: drp; slp with --replan and no "
        "--config)",
    )
    group.add_argument(
        "--weight", type=number(above=0), help="all relaxation weights (default: 100)"
    )
    group.add_argument(
        "--iterations", type=positive_int, help="largest number of iterations (default: 3000)"
    )
    group.add_argument(
        "--seconds",
        type=number(above=0),
        help="time for everything before the evaluation (default: 90); of one training without its "
        "compilation (default: none for the preset paper, the file's for --config)",
    )
    group.add_argument(
        "--restarts",
        type=positive_int,
        help="policies trained side by side; the best is kept (default: 1)",
    )
    group.add_argument("--batch", type=positive_int, help="rollouts an iteration (default: 1)")
