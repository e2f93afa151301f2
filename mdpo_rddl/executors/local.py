"""One task after the other, in this process."""

from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")


class LocalExecutor:
    """Does the tasks in their order; an error ends it."""

    def run(self, work: Callable[[T], None], tasks: Sequence[T]) -> None:
        """See `Executor`."""
        for task in tasks:
            work(task)
