"""Programs that play policies, one for each set of parts that their parameters have."""

import math
from collections.abc import Callable
from typing import Generic, TypeVar

import jax
from jax import Array

from mdpo_rddl.auto.common.timing import Clock, Timed, made_once
from mdpo_rddl.planner.plans.feedback import Params

Result = TypeVar("Result")

_Play = Callable[[Array, Params], Result]


class ByParts(Generic[Result]):
    """Plays policies; each set of parts has a program of its own, compiled when first called.

    Attributes:
      seconds: of the latest call; 0 before the first.
    """

    def __init__(
        self, make: Callable[[], _Play[Result]], clock: Clock, deadline: float = math.inf
    ) -> None:
        """Compiles nothing yet.

        Args:
          make: makes what plays, which returns once it has computed its result.
          clock: what times it.
          deadline: until when a program is waited for, by the clock.
        """
        self._make, self._clock, self._deadline = make, clock, deadline
        self._programs: dict[object, Timed[[Array, Params], Result]] = {}
        self.seconds = 0.0

    def __call__(self, key: Array, params: Params) -> Result:
        """What a call returns, for parameters of any parts.

        Raises:
          TooLateError: if the deadline comes before the end of a program's first call.
        """
        parts = jax.tree.structure(params)
        if parts not in self._programs:
            self._programs[parts] = Timed(made_once(self._make), self._clock, self._deadline)
        program = self._programs[parts]
        result = program(key, params)
        self.seconds = program.seconds
        return result

    def is_compiled(self, params: Params | None = None) -> bool:
        """Whether policies of such parts, or of any if None, were played."""
        if params is None:
            return any(program.calls for program in self._programs.values())
        program = self._programs.get(jax.tree.structure(params))
        return program is not None and program.calls > 0

    @property
    def compile_seconds(self) -> float:
        """What the first calls took longer than the latest, of all programs together."""
        return sum(program.compile_seconds for program in self._programs.values())
