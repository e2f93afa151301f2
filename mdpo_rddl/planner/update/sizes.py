"""How many iterations a compiled call has, and after how many of them it tests."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CallSizes:
    """The sizes of a call.

    Attributes:
      iterations: of one call.
      test_every: iterations from one test to the next.

    Raises:
      ValueError: if a call is not made of whole blocks that end with a test.
    """

    iterations: int
    test_every: int

    def __post_init__(self) -> None:
        if min(self.iterations, self.test_every) < 1 or self.iterations % self.test_every:
            raise ValueError("test_every must divide iterations_per_call, both at least 1")

    def bounded(self, iterations: float) -> "CallSizes":
        """Sizes of a call of at most so many iterations, or of one."""
        most = max(1, int(min(self.iterations, iterations)))
        test_every = min(self.test_every, most)
        return CallSizes(most // test_every * test_every, test_every)
