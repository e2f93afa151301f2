"""What the commands do: each takes the parsed options, returns its table."""

import argparse
from itertools import product

from benchmarks.commands.noise import noise_value
from benchmarks.commands.paper import PAPER_COMMANDS
from benchmarks.commands.tasks import TASK_COMMANDS
from benchmarks.common.size import Size
from benchmarks.configs.sweep import Grid, config_sweep_table, run_config_sweep, ship
from benchmarks.optima.optima import (
    Task,
    fully_observed_tasks,
    optima_table,
    read_published,
    run_optima,
)
from benchmarks.presets.auto import auto_table, run_auto
from benchmarks.presets.noise_sweep import NoisePoint, sweep, sweep_table
from benchmarks.presets.paper_preset import paper_preset_table, run_paper_preset
from benchmarks.presets.transfer import run_transfer, transfer_table
from benchmarks.problems.compatibility import compatibility_table, run_compatibility
from benchmarks.problems.exactness import exactness_table, run_exactness
from benchmarks.problems.ipc_smoke import ipc_smoke_table, run_ipc_smoke
from benchmarks.problems.legal_play import legal_play_table, run_legal_play
from benchmarks.problems.simulator_law import law_table, run_law
from benchmarks.problems.simulator_speed import run_simulator, simulator_table
from benchmarks.speed.growth import growth_table, run_growth
from benchmarks.speed.profile import profile_table, run_profile
from benchmarks.speed.speed import run_speed, speed_table
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.jax_setup import keep_compiled_programs, use_all_cores
from mdpo_rddl.planner.config.presets.paper import PYTORCH_DECAY


def _transfer(options: argparse.Namespace) -> str:
    return transfer_table(run_transfer(options.out, options.pairs, options.seconds, options.seed))


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


def _exactness(options: argparse.Namespace) -> str:
    limits = Limits(options.timeout, options.memory_gb)
    records = run_exactness(options.out, options.problems, options.max_horizon, limits)
    return exactness_table(records)


def _simulator(options: argparse.Namespace) -> str:
    limits = Limits(options.timeout, options.memory_gb)
    return simulator_table(run_simulator(options.out, options.problems, limits).rows)


def _simulator_law(options: argparse.Namespace) -> str:
    return law_table(run_law(options.out, options.problems).rows)


def _legal_play(options: argparse.Namespace) -> str:
    limits = Limits(options.timeout, options.memory_gb)
    given = options.problems, options.policies, options.steps
    return legal_play_table(run_legal_play(options.out, *given, limits))


def _optima(options: argparse.Namespace) -> str:
    published = read_published(options.published) if options.published else None
    names = fully_observed_tasks(options.problems, options.instances)
    tasks = [
        Task(*name, options.timeout, options.memory_gb, options.episodes)
        for name in names
        if published is None or name in published
    ]
    return optima_table(run_optima(options.out, tasks), published)


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
        Grid(options.domains, options.instances, options.plans, options.candidates),
        options.seconds,
        options.episodes,
        Limits(options.timeout, options.memory_gb),
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
        [NoisePoint(*map(float, point)) for point in product(options.alphas, options.sigma_maxes)],
        Size(options.seeds, options.iterations, options.episodes),
        PYTORCH_DECAY if options.decay is None else options.decay,
    )
    return sweep_table(records)


def _paper_preset(options: argparse.Namespace) -> str:
    records = run_paper_preset(
        options.out,
        options.settings,
        options.noises,
        Size(options.seeds, options.iterations, options.episodes),
        options.decay,
    )
    return paper_preset_table(records)


COMMANDS = {
    "noise-sweep": _noise_sweep,
    "paper-preset": _paper_preset,
    "profile": _profile,
    "speed": _speed,
    "auto": _auto,
    "transfer": _transfer,
    "compatibility": _compatibility,
    "exactness": _exactness,
    "simulator": _simulator,
    "simulator-law": _simulator_law,
    "legal-play": _legal_play,
    "ipc-smoke": _ipc_smoke,
    "optima": _optima,
    "noise-value": noise_value,
    "configs": _configs,
    "growth": _growth,
    **TASK_COMMANDS,
    **PAPER_COMMANDS,
}
"""By the commands' names."""
