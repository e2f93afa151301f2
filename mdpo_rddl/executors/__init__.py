"""Where the work is done: on this machine, or on a cluster."""

from collections.abc import Mapping
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.executors.base import Executor
from mdpo_rddl.executors.local import LocalExecutor

_EXECUTORS = {"local": LocalExecutor}
EXECUTORS = tuple(_EXECUTORS)


def make_executor(name: str, options: Mapping[str, Any]) -> Executor:
    """An executor by its name.

    Args:
      name: out of `EXECUTORS`.
      options: the keyword arguments of its class.

    Raises:
      InputError: if there is none of that name.
    """
    if name not in _EXECUTORS:
        raise InputError(f"unknown executor {name!r}, known are {', '.join(EXECUTORS)}")
    return _EXECUTORS[name](**options)


__all__ = ["EXECUTORS", "Executor", "LocalExecutor", "make_executor"]
