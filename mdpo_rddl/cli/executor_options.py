"""Options that say where the work is done."""

import argparse
from pathlib import Path
from typing import Any

from mdpo_rddl.cli.options import number, positive_int
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.executors import EXECUTORS, Executor, SlurmExecutor, make_executor

_JOBS = "jobs"
_OPTIONS: dict[str, tuple[Any, str]] = {
    "cpus": (positive_int, "of each job"),
    "memory_gb": (number(above=0), "of each job"),
    "minutes": (positive_int, "time limit of each job; it is requeued then"),
    "partition": (str, "where to (default: Slurm's)"),
    "parallel": (positive_int, "most jobs at a time"),
}


def add_executor_options(parser: argparse.ArgumentParser) -> None:
    """Adds `--executor`, and Slurm's resources as `--slurm-cpus` and so on."""
    group = parser.add_argument_group("where it runs")
    group.add_argument(
        "--executor",
        choices=EXECUTORS,
        default="local",
        help="one after the other on this machine, or as a Slurm job array (default: %(default)s)",
    )
    for name, (kind, text) in _OPTIONS.items():
        default = getattr(SlurmExecutor, name)
        shown = "" if default is None else f" (default: {default:g})"
        group.add_argument(_option(name), metavar="X", type=kind, help=text + shown)


def executor_from(options: argparse.Namespace, out: Path) -> Executor:
    """The executor that was asked for.

    Args:
      options: what a parser with these options has parsed.
      out: the results folder; the jobs' logs go to a folder in it.

    Raises:
      InputError: if an option of Slurm's is given without it.
    """
    given = _given(options)
    if options.executor == "local":
        if given:
            raise InputError(f"{_option(next(iter(given)))} needs --executor slurm")
        return make_executor("local", {})
    return make_executor(options.executor, {"folder": out / _JOBS, **given})


def hardware(options: argparse.Namespace) -> dict[str, Any]:
    """What a run's conditions say of the machine: the executor and the cores of a task."""
    cores = usable_cores()
    if options.executor == "slurm":
        cores = _given(options).get("cpus", SlurmExecutor.cpus)
    return {"executor": options.executor, "cores": cores}


def _given(options: argparse.Namespace) -> dict[str, Any]:
    values = {name: getattr(options, f"slurm_{name}") for name in _OPTIONS}
    return {name: value for name, value in values.items() if value is not None}


def _option(name: str) -> str:
    return "--slurm-" + name.replace("_", "-")
