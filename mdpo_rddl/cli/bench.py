"""`mdpo-bench`: the measurements that the project reports."""

import argparse
import logging
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mdpo_rddl.bench.common.settings import DOMAIN_FILES
from mdpo_rddl.bench.configs.candidates import PLANS, SCALES
from mdpo_rddl.bench.configs.sweep import config_sweep_table, run_config_sweep, ship
from mdpo_rddl.bench.presets.auto import PLANNERS, auto_table, run_auto
from mdpo_rddl.bench.presets.noise_sweep import sweep, sweep_table
from mdpo_rddl.bench.presets.paper_preset import NOISES, paper_preset_table, run_paper_preset
from mdpo_rddl.bench.problems.compatibility import compatibility_table, run_compatibility
from mdpo_rddl.bench.problems.ipc_smoke import DOMAINS, INSTANCES, ipc_smoke_table, run_ipc_smoke
from mdpo_rddl.bench.speed.growth import AXES, growth_table, run_growth
from mdpo_rddl.bench.speed.profile import profile_table, run_profile
from mdpo_rddl.bench.speed.speed import SETTINGS, run_speed, speed_table
from mdpo_rddl.cli.bench_noise import add_noise_command
from mdpo_rddl.cli.bench_paper import add_paper_commands
from mdpo_rddl.cli.options import OneLineParser, number, positive_int
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.jax_setup import keep_compiled_programs, use_all_cores
from mdpo_rddl.planner.config.presets.auto import AUTO_SECONDS
from mdpo_rddl.planner.config.presets.paper import PYTORCH_DECAY


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Returns:
      The exit status: 0, 2 for bad input, 130 after an interrupt.
    """
    options = _parser().parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    logging.getLogger("jax").setLevel(logging.WARNING)
    warnings.simplefilter("ignore")
    try:
        table = options.run(options)
        _write(options.out / "table.md", table)
    except InputError as error:
        print(f"mdpo-bench: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("mdpo-bench: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    print(table, end="")
    return 0


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="mdpo-bench", description="Measure what the project reports.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=OneLineParser)

    noise = commands.add_parser("noise-sweep", help="alpha and sigma_max of the paper preset")
    noise.add_argument("--alphas", nargs="+", type=number(above=0), default=[0.25, 0.5, 1, 2, 4])
    noise.add_argument("--sigma-maxes", nargs="+", type=number(at_least=0), default=[10])
    noise.set_defaults(run=_noise_sweep, out=Path("results/noise_sweep"))

    paper = commands.add_parser("paper-preset", help="the paper preset, with and without noise")
    paper.add_argument("--noises", nargs="+", choices=list(NOISES), default=list(NOISES))
    paper.set_defaults(run=_paper_preset, out=Path("results/paper_preset"))

    for command in (noise, paper):
        command.add_argument(
            "--settings", nargs="+", choices=list(DOMAIN_FILES), default=list(DOMAIN_FILES)
        )
        command.add_argument(
            "--decay",
            type=number(above=0, at_most=1),
            help="RMSProp's (default: 0.99 in the sweep, else the preset's)",
        )
        command.add_argument("--seeds", type=positive_int, default=5)
        command.add_argument("--iterations", type=positive_int, default=3000)
        command.add_argument("--episodes", type=positive_int, default=20)
    noise.set_defaults(decay=PYTORCH_DECAY)
    speed = commands.add_parser("speed", help="iterations a second, against JaxPlan's loop")
    profile = commands.add_parser("profile", help="where the time of an iteration goes")
    for command, seconds in ((speed, 3), (profile, 1)):
        command.add_argument("--settings", nargs="+", choices=list(DOMAIN_FILES), default=SETTINGS)
        command.add_argument("--turns", type=positive_int, default=5, help="of each side")
        command.add_argument(
            "--seconds", type=number(above=0), default=seconds, help="of each turn"
        )
    profile.set_defaults(run=_profile, out=Path("results/profile"))
    speed.add_argument(
        "--command-turns",
        metavar="N",
        type=int,
        choices=range(100),
        default=3,
        help="of the whole command; 0: none",
    )
    speed.set_defaults(run=_speed, out=Path("results/speed"))

    auto = commands.add_parser(
        "auto", help="the preset auto against experts and JaxPlan's defaults"
    )
    auto.add_argument(
        "--problems",
        nargs="+",
        metavar="NAME",
        default=list(DOMAIN_FILES),
        help="settings, or Problem:instance of rddlrepository (default: the six settings)",
    )
    auto.add_argument("--planners", nargs="+", choices=PLANNERS, default=["expert", "auto"])
    auto.add_argument("--seeds", type=positive_int, default=5)
    auto.add_argument("--seconds", type=number(above=0), default=AUTO_SECONDS)
    auto.add_argument("--episodes", type=positive_int, default=50)
    auto.set_defaults(run=_auto, out=Path("results/auto"))

    others = [auto, *_add_trial_commands(commands), *add_paper_commands(commands)]
    others.append(add_noise_command(commands))
    for command in (noise, paper, speed, profile, *others):
        command.add_argument("--out", metavar="DIR", type=Path, help="results folder")
    return parser


def _add_trial_commands(commands: Any) -> list[OneLineParser]:
    everything = commands.add_parser(
        "compatibility", help="every problem of rddlrepository, with JaxPlan and with ours"
    )
    everything.add_argument(
        "--problems", nargs="+", metavar="NAME", help="of rddlrepository (default: all)"
    )
    everything.add_argument(
        "--instance", default="first", help="its name (default: the first of each problem)"
    )
    everything.add_argument("--iterations", type=positive_int, default=3)
    everything.add_argument(
        "--max-horizon", type=positive_int, default=20, help="cuts a longer one (default: 20)"
    )
    everything.set_defaults(run=_compatibility, out=Path("results/compatibility"), timeout=900)

    smoke = commands.add_parser("ipc-smoke", help="the eight IPC 2023 domains with ours")
    smoke.add_argument("--domains", nargs="+", choices=DOMAINS, default=list(DOMAINS))
    smoke.add_argument("--instances", nargs="+", metavar="NAME", default=list(INSTANCES))
    smoke.add_argument("--iterations", type=positive_int, default=50)
    smoke.add_argument("--episodes", type=positive_int, default=2)
    smoke.set_defaults(run=_ipc_smoke, out=Path("results/ipc_smoke"), timeout=7200)

    configs = commands.add_parser(
        "configs", help="configurations for the eight IPC 2023 domains, against JaxPlan's own"
    )
    configs.add_argument("--domains", nargs="+", choices=list(SCALES), default=list(SCALES))
    configs.add_argument("--instances", nargs="+", metavar="NAME", default=["3"])
    configs.add_argument("--plans", nargs="+", choices=PLANS, default=PLANS)
    configs.add_argument(
        "--candidates",
        nargs="+",
        metavar="NAME",
        help="'chosen' is what the results so far speak for (default: all)",
    )
    configs.add_argument("--seconds", type=number(above=0), default=20)
    configs.add_argument("--episodes", type=positive_int, default=10)
    configs.add_argument(
        "--ship", metavar="FOLDER", type=Path, help="write the chosen configurations there"
    )
    configs.set_defaults(run=_configs, out=Path("results/configs"), timeout=600)

    growth = commands.add_parser("growth", help="time and memory of an iteration against sizes")
    growth.add_argument("--axes", nargs="+", choices=list(AXES), default=list(AXES))
    growth.add_argument("--seconds", type=number(above=0), default=5)
    growth.set_defaults(run=_growth, out=Path("results/growth"), timeout=900)

    for command in (everything, smoke, configs, growth):
        command.add_argument(
            "--timeout",
            metavar="SECONDS",
            type=number(above=0),
            default=command.get_default("timeout"),
            help="of each planner (default: %(default)s)",
        )
        command.add_argument(
            "--memory-gb",
            metavar="GB",
            type=number(above=0),
            default=8,
            help="of each process (default: %(default)s)",
        )
    return [everything, smoke, configs, growth]


def _auto(options: argparse.Namespace) -> str:
    keep_compiled_programs()
    names = ("problems", "planners", "seeds", "seconds", "episodes")
    return auto_table(run_auto(options.out, *(getattr(options, name) for name in names)))


def _compatibility(options: argparse.Namespace) -> str:
    records = run_compatibility(
        options.out,
        options.problems,
        None if options.instance == "first" else options.instance,
        options.iterations,
        options.max_horizon,
        Limits(options.timeout, options.memory_gb),
    )
    return compatibility_table(records)


def _ipc_smoke(options: argparse.Namespace) -> str:
    records = run_ipc_smoke(
        options.out,
        options.domains,
        options.instances,
        options.iterations,
        options.episodes,
        Limits(options.timeout, options.memory_gb),
    )
    return ipc_smoke_table(records)


def _configs(options: argparse.Namespace) -> str:
    records = run_config_sweep(
        options.out,
        options.domains,
        options.instances,
        options.candidates,
        options.seconds,
        options.episodes,
        Limits(options.timeout, options.memory_gb),
        options.plans,
    )
    if options.ship is not None:
        ship(records, options.ship)
    return config_sweep_table(records)


def _growth(options: argparse.Namespace) -> str:
    limits = Limits(options.timeout, options.memory_gb)
    return growth_table(run_growth(options.out, options.axes, options.seconds, limits))


def _speed(options: argparse.Namespace) -> str:
    use_all_cores()
    records = run_speed(
        options.out, options.settings, options.turns, options.seconds, options.command_turns
    )
    return speed_table(records)


def _profile(options: argparse.Namespace) -> str:
    use_all_cores()
    return profile_table(run_profile(options.out, options.settings, options.turns, options.seconds))


def _noise_sweep(options: argparse.Namespace) -> str:
    records = sweep(
        options.out,
        options.settings,
        options.alphas,
        options.sigma_maxes,
        options.seeds,
        options.iterations,
        options.episodes,
        options.decay,
    )
    return sweep_table(records)


def _paper_preset(options: argparse.Namespace) -> str:
    records = run_paper_preset(
        options.out,
        options.settings,
        options.noises,
        options.seeds,
        options.iterations,
        options.episodes,
        options.decay,
    )
    return paper_preset_table(records)


if __name__ == "__main__":
    sys.exit(main())
