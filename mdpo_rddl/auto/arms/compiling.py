"""What an arm is whose program is compiled while others work."""

import contextlib
import logging
import math
import time
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.common.candidate import has_structure
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.machine.background import Background
from mdpo_rddl.machine.device import as_here
from mdpo_rddl.planner.planner import MDPOPlanner

logger = logging.getLogger(__name__)

LONGEST_WAIT = 2.0
"""Of what a program is likely to take: how long it is worth waiting for."""


class CompilingArm(ArenaArm):
    """An arm whose program is compiled in a thread while others work: nothing interrupts that.

    Attributes:
      descends: whether it goes on from the best policy so far, whoever found that.
      usual_seconds: what its first program is likely to take.
    """

    descends = False

    def __init__(self, name: str, arena: Arena, usual_seconds: float = 0.0) -> None:
        """Does nothing yet; the other arguments are those of `ArenaArm`."""
        super().__init__(name, arena)
        self.usual_seconds = usual_seconds
        self._compiling: Background | None = None
        self._waited = 0.0
        self._estimate = -math.inf

    @property
    def is_pending(self) -> bool:
        """Whether the compilation goes on."""
        return self._compiling is not None and not self._compiling.has_ended

    def is_worth_waiting(self, seconds: float) -> bool:
        """Whether its program can be ready in time, and was not waited for much too long.

        Args:
          seconds: that are left.
        """
        usual, waited = self.usual_seconds, self._waited
        return self.is_pending and waited < LONGEST_WAIT * usual and usual - waited < seconds

    def begin(self, until: float) -> None:
        """Begins the compilation, and waits for it; what it raises is for the first slice.

        Args:
          until: how long to wait, by the clock.
        """
        started = self._clock()
        self._begin()
        self._log.seconds += self._clock() - started
        self.await_program(until)

    def await_program(self, until: float) -> None:
        """Waits for what is compiled, as `Arm` says."""
        started = self._clock()
        try:
            with contextlib.suppress(Exception):
                self._is_compiled(until)
        finally:
            waited = self._clock() - started
            self._waited += waited
            self._log.seconds += waited

    @property
    def reached(self) -> float | None:
        """By the judge, else by the arm's own estimate."""
        judged = self._log.best_return
        return self._estimate if judged is None and math.isfinite(self._estimate) else judged

    def _earlier_params(self, planner: MDPOPlanner) -> Any:
        """What the arm had found in a race that was stopped; None without that.

        Args:
          planner: the arm's own, whose parameters must have the same shapes.
        """
        found = self._arena.judge.best_of_arm(self.name)
        if found is None:
            return None
        fits = has_structure(planner, found.params, found.policy_hyperparams)
        return found.params if fits else None

    @abstractmethod
    def _begin(self) -> None:
        """Calls `_start`."""

    def _start(self, compile_program: Callable[[], None], in_turn: bool = True) -> None:
        """Begins a compilation.

        Args:
          compile_program: does it; must not ask the clock, which may raise for the caller only.
          in_turn: whether after those of other arms, if there is time for it then; else now.
        """

        def timed() -> None:
            started = time.monotonic()
            compile_program()
            self._log.compile_seconds += time.monotonic() - started

        if in_turn:
            left = self._arena.deadline - self._clock() - self.usual_seconds
            self._compiling = self._arena.compilations.add(timed, left)
        else:
            self._compiling = Background(as_here(timed))

    def _is_compiled(self, until: float) -> bool:
        """Waits for the compilation; one that was given up for want of time ends the arm.

        Args:
          until: how long, by the clock.

        Raises:
          Exception: whatever it has raised.
        """
        assert self._compiling is not None
        try:
            # a thread is waited for by the machine's clock
            return self._compiling.wait(time.monotonic() + until - self._clock())
        except TooLateError as error:
            logger.info("%s: %s", self.name, error)
            self._log.details = {**self._log.details, "cause": str(error)}
            self.is_exhausted = True
            return False
