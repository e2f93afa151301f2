"""What an executor is: something that works through tasks, here or elsewhere."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

T = TypeVar("T")


class Executor(Protocol):
    """Runs one function on many tasks and returns when all are done."""

    def run(self, work: Callable[[T], None], tasks: Sequence[T]) -> None:
        """Works through the tasks.

        Args:
          work: a function at the top of a module; it writes its own results, each file in one
            step, and leaves what it finds done, so that it can be called again.
          tasks: what to call it with; picklable.
        """
