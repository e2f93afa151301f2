"""Where independent pieces of work are done: here, or by a cluster."""

from collections.abc import Mapping
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.executors.base import Executor
from mdpo_rddl.executors.local import LocalExecutor

EXECUTORS = ("local",)


def make_executor(name: str, options: Mapping[str, Any]) -> Executor:
    """The executor of that name.

    Args:
      name: one of `EXECUTORS`.
      options: what it is to be given; the local one takes nothing.

    Raises:
      InputError: if there is no such executor.
    """
    del options
    if name not in EXECUTORS:
        raise InputError(f"unknown executor {name!r}, known are {', '.join(EXECUTORS)}")
    return LocalExecutor()


__all__ = ["EXECUTORS", "Executor", "make_executor"]
