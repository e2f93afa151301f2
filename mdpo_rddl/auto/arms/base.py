"""What every arm is: something that looks for a policy for a slice of time, and can go on."""

import math
from abc import ABC, abstractmethod

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.planner.plans.feedback import Params

FIRST_SLICES = 2
"""Slices of the rounds, shorter ones, that an arm has before anything is made of its pace."""


class Arm(ABC):
    """One way to find a policy.

    Arms do not know each other. What one has found reaches another through the arena, whose
    judge knows the best candidate so far.

    Attributes:
      name: for people, one of its own.
      is_exhausted: whether another slice would be of no use.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        """Does nothing yet."""
        self.name, self._clock = name, clock
        self.is_exhausted = False
        self._log = ArmLog(name)
        self._is_prepared = False
        self._new: list[Candidate] = []

    def prepare(self) -> None:
        """Compiles what the first slice needs; done once, at the latest by `work`."""
        if self._is_prepared:
            return
        self._is_prepared = True
        started = self._clock()
        try:
            self._prepare()
        finally:
            seconds = self._clock() - started
            self._log.seconds += seconds
            self._log.compile_seconds += seconds

    def work(self, until: float) -> None:
        """Goes on looking for a policy for a slice of time.

        Args:
          until: when to end, by the clock.
        """
        self.prepare()
        started = self._clock()
        self._log.slices += 1
        try:
            self._work(until)
        finally:
            self._log.seconds += self._clock() - started

    @property
    def is_pending(self) -> bool:
        """Whether something is still compiled for it, which a slice would only wait for."""
        return False

    def is_worth_waiting(self, seconds: float) -> bool:
        """Whether others had better not delay what is compiled for it.

        Args:
          seconds: that are left.
        """
        del seconds
        return False

    def await_program(self, until: float) -> None:  # noqa: B027  (most have nothing to wait for)
        """Waits for what is compiled; what that raises is for the next slice.

        Args:
          until: how long, by the clock.
        """

    def take_candidates(self) -> list[Candidate]:
        """The candidates since the last time, for the judge."""
        taken, self._new = self._new, []
        return taken

    def judged(self, candidate: Candidate) -> None:
        """Is told what the judge says of one of its candidates."""
        best = self._log.best_return
        mean = candidate.known_mean
        self._log.best_return = mean if best is None else max(best, mean)

    @property
    def reached(self) -> float | None:
        """The return that it has reached; None before there is any."""
        return self._log.best_return

    @property
    def progress(self) -> float:
        """What rises while slices in a row are of use; minus infinity before there is any."""
        return -math.inf if self.reached is None else self.reached

    @property
    def log(self) -> ArmLog:
        """What it was given and what it did so far."""
        return self._log

    def close(self) -> None:  # noqa: B027  (most have nothing to give back)
        """The race is over; the state is what it was."""

    def _prepare(self) -> None:  # noqa: B027  (an arm may have nothing to prepare)
        """What `prepare` does once."""

    @abstractmethod
    def _work(self, until: float) -> None:
        """What `work` does: candidates are offered as they are found."""

    def _offer(self, candidate: Candidate) -> None:
        self._new.append(candidate)


class ArenaArm(Arm):
    """An arm that works with the arena's own planner."""

    def __init__(self, name: str, arena: Arena) -> None:
        """Does nothing yet.

        Args:
          name: for people.
          arena: what all arms have in common.
        """
        super().__init__(name, arena.clock)
        self._arena = arena

    def _offer_child(self, parent: Candidate | None, label: str, params: Params) -> None:
        """Offers what was made from another candidate, or from nobody's."""
        if parent is None or not parent.arm:
            self._offer(self._arena.candidate(self.name, label, params))
        else:
            self._offer(parent.child(self.name, label, params))
