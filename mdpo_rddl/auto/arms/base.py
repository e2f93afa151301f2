"""What every arm is: something that looks for a policy for a slice of time, and can go on."""

import contextlib
import logging
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arm_log import ArmLog
from mdpo_rddl.auto.candidate import Candidate, has_structure
from mdpo_rddl.auto.compilations import TooLateError
from mdpo_rddl.auto.state import UNFIT, State
from mdpo_rddl.auto.timing import Clock
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.background import Background
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.training import Training, TrainingResult

logger = logging.getLogger(__name__)

REPLAY_SECONDS = 2.0
"""To find what is not finite, while the other arms wait."""


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
        self._at_work_since: float | None = None
        self._new: list[Candidate] = []
        self._unjudged = 0

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
        started = self._at_work_since = self._clock()
        self._log.slices += 1
        try:
            self._work(until)
        finally:
            self._log.seconds += self._clock() - started
            self._at_work_since = None

    @property
    def is_pending(self) -> bool:
        """Whether something is still compiled for it, which a slice would only wait for."""
        return False

    @property
    def awaits_judge(self) -> bool:
        """Whether it seems to lead, and the judge could not yet play what it has found."""
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
        self._unjudged -= 1
        best = self._log.best_return
        mean = candidate.known_mean
        self._log.best_return = mean if best is None else max(best, mean)

    @property
    def is_over(self) -> bool:
        """Whether another slice would be of no use, and all that it has found was judged."""
        return self.is_exhausted and not self._unjudged

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

    @property
    def log_so_far(self) -> ArmLog:
        """A copy of the log, with the seconds of the slice that goes on."""
        since, log = self._at_work_since, self.log
        more = 0.0 if since is None else self._clock() - since
        return replace(log, seconds=log.seconds + more)

    def take_over(self, log: ArmLog, is_exhausted: bool) -> None:
        """Counts on from what an arm of its name has done in another process."""
        for each in ("slices", "seconds", "compile_seconds", "iterations", "best_return"):
            setattr(self._log, each, getattr(log, each))
        self._log.details, self.is_exhausted = dict(log.details), is_exhausted

    def state(self) -> State | None:
        """What it needs to go on in another process; None if it has nothing but its best policy.

        It is asked for between two iterations of a slice, and between slices.
        """
        return None

    def restore(self, state: State) -> None:  # noqa: B027  (most have nothing to restore)
        """Goes on, before its first slice, with what `state` has said in another process.

        Raises:
          AttributeError, LookupError, OverflowError, TypeError, ValueError: if that does not fit
            this problem; the arm begins as if there were none then.
        """

    def _try(self, restore: Callable[[State], None], state: State) -> bool:
        """Whether a state could be restored; one that does not fit is left out, which is said."""
        try:
            restore(state)
        except (InputError, *UNFIT) as error:
            logger.info("%s: its state is left out: %s", self.name, one_line_cause(error))
            return False
        return True

    def _prepare(self) -> None:  # noqa: B027  (an arm may have nothing to prepare)
        """What `prepare` does once."""

    @abstractmethod
    def _work(self, until: float) -> None:
        """What `work` does: candidates are offered as they are found."""

    def _offer(self, candidate: Candidate) -> None:
        self._new.append(candidate)
        self._unjudged += 1


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
        self._estimate = -math.inf
        self._is_judged = self._awaits_judge = False

    @property
    def is_pending(self) -> bool:
        """Whether the compilation goes on."""
        return self._compiling is not None and not self._compiling.has_ended

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
            self._log.seconds += self._clock() - started

    @property
    def awaits_judge(self) -> bool:
        """Whether what plays its policies is compiled, or was, since its latest slice."""
        leads = self._estimate > self._arena.judge.best_mean
        return self._awaits_judge and leads and not self.is_exhausted

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

    def _note_not_finite(self, training: Training, result: TrainingResult) -> None:
        """Counts what is not finite, in the worst phase, and says once where it arises."""
        count, details = result.not_finite + result.lost_sensitivities, self._log.details
        if count and "advice" not in details:
            advice = result.advice or training.diagnosis(seconds=REPLAY_SECONDS)
            self._log.details = {**details, "advice": advice}
        if count:
            count = max(count, details.get("not_finite", 0))
            self._log.details = {**self._log.details, "not_finite": count}

    def _may_be_judged(self, planner: MDPOPlanner, params: Any, until: float) -> bool:
        """Whether the judge can play a planner's policies.

        What that needs is compiled once the arm's estimate exceeds the incumbent's return, so
        that an arm that finds nothing costs less. It begins at once, whatever else is compiled.

        Args:
          planner: the arm's own.
          params: of any of its policies.
          until: of the slice; others work while it is not compiled by then.
        """
        judge = self._arena.judge
        if not self._is_judged:
            self._log.details = {**self._log.details, "estimate": self._estimate}
            # also where it is no number
            if not self._estimate > judge.best_mean:
                return False
            if self._arena.deadline - self._clock() < judge.usual_seconds:
                return False
            self._is_judged = self._awaits_judge = True
            self._start(lambda: judge.prepare(planner, params), in_turn=False)
        is_ready = self._is_compiled(until)
        self._awaits_judge &= not is_ready
        return is_ready

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
            self._compiling = Background(timed)

    def _is_compiled(self, until: float) -> bool:
        """Waits for the compilation; one that was not begun in time ends the arm.

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
            self._log.details = {"cause": str(error)}
            self.is_exhausted = True
            return False
