"""Here, in this process."""

from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")


class LocalExecutor:
    """Works through the tasks one after the other, so that each has the whole machine."""

    def run(self, work: Callable[[T], None], tasks: Sequence[T]) -> None:
        """Calls `work` with each task in turn."""
        for task in tasks:
            work(task)
