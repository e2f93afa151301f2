"""Where the work is done: on this machine, or on a cluster."""

from collections.abc import Mapping
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.executors.base import Executor
from mdpo_rddl.machine.executors.local import LocalExecutor
from mdpo_rddl.machine.executors.slurm import SlurmExecutor

EXECUTORS = ("local", "slurm")


def make_executor(name: str, options: Mapping[str, Any]) -> Executor:
    """An executor by its name.

    Args:
      name: out of `EXECUTORS`.
      options: the keyword arguments of its class; "local" takes none.

    Raises:
      InputError: if there is none of that name.
    """
    if name == "local":
        return LocalExecutor(**options)
    if name == "slurm":
        return SlurmExecutor(**options)
    raise InputError(f"unknown executor {name!r}, known are {', '.join(EXECUTORS)}")


__all__ = ["EXECUTORS", "Executor", "LocalExecutor", "SlurmExecutor", "make_executor"]
