"""What every executor does."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

T = TypeVar("T")


class Executor(Protocol):
    """Does pieces of work that do not depend on each other."""

    def run(self, work: Callable[[T], None], tasks: Sequence[T]) -> None:
        """Does the work on every task.

        Args:
          work: a function of a module, so that another process finds it; writes its own
            results, whole or not at all.
          tasks: one picklable argument each.
        """
