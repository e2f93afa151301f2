"""Tells how planning gets on, and ends it early when somebody wants that."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mdpo_rddl.errors import Cancelled
from mdpo_rddl.machine.html import html_table
from mdpo_rddl.session.requests import Incumbent, Reporter

if TYPE_CHECKING:  # which imports JAX
    from mdpo_rddl.planner.training.training import Progress

_TELL_SECONDS = 0.25


@dataclass(frozen=True)
class PlanProgress:
    """How far planning is.

    Attributes:
      stage: what goes on: "loading", "probing", "searching" or "confirming"; in one training
        "compiling" or "training".
      seconds: since it began.
      fraction: of the time, from 0 to 1; of the iterations, if they end a training first.
      best_return: mean return of the best policy so far on the exact model; None before the first.
      leader: the arm of a race that found it; None outside of a race.
    """

    stage: str
    seconds: float
    fraction: float
    best_return: float | None = None
    leader: str | None = None

    def _repr_html_(self) -> str:
        best = "none" if self.best_return is None else f"{self.best_return:z,.2f}"
        rows: Mapping[str, str] = {
            "stage": self.stage,
            "seconds": f"{self.seconds:.1f}",
            "done": f"{self.fraction:.0%}",
            "best return": best if self.leader is None else f"{best} by {self.leader}",
        }
        return html_table("Planning", rows)


class Watch:
    """A reporter that ends planning early, between two iterations, once it is cancelled.

    Attributes:
      seconds: the time for everything.
      error: what the callback has raised, if anything; it cancels too.
    """

    def __init__(
        self,
        seconds: float,
        reporter: Reporter,
        on_progress: Callable[[PlanProgress], object] | None = None,
        cancel: threading.Event | None = None,
    ) -> None:
        """Begins to count the time.

        Args:
          seconds: the time for everything.
          reporter: is told everything too.
          on_progress: called several times a second at most, from whatever thread is at work;
            False from it cancels.
          cancel: cancels once it is set.
        """
        self.seconds, self._reporter = seconds, reporter
        self._on_progress = on_progress
        self._cancel = cancel or threading.Event()
        self._began = time.monotonic()
        self._told_at = -float("inf")
        self._stage, self._fraction = "loading", 0.0
        self._best: float | None = None
        self._leader: str | None = None
        self._is_ended = False
        self.error: BaseException | None = None

    @property
    def is_cancelled(self) -> bool:
        """Whether planning should end."""
        return self._is_ended or self._cancel.is_set()

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self._began

    def stage(self, name: str) -> None:
        """A new stage begins."""
        self._stage = name
        self._reporter.stage(name)
        self._tell(at_once=True)

    def training(self, progress: "Progress") -> None:
        """An iteration is done.

        Raises:
          Cancelled: if planning should end.
        """
        self._stage, self._fraction = "training", progress.fraction
        if self._best is None or progress.best_return > self._best:
            self._best = progress.best_return
        self._reporter.training(progress)
        self._tell()
        if self.is_cancelled:
            raise Cancelled

    def racing(self, fraction: float) -> None:
        """A race goes on, of whose time so large a part is over.

        Raises:
          Cancelled: if planning should end.
        """
        self._fraction = fraction
        self._reporter.racing(fraction)
        self._tell()
        if self.is_cancelled:
            raise Cancelled

    def incumbent(self, found: Incumbent) -> None:
        """A race has a better policy than before."""
        self._best, self._leader = found.mean, found.arm
        self._reporter.incumbent(found)

    def episode(self, done: int, of: int) -> None:
        """An evaluation episode is done."""
        self._reporter.episode(done, of)

    def _tell(self, at_once: bool = False) -> None:
        elapsed = self.elapsed
        if self._on_progress is None or self.is_cancelled:
            return
        if not at_once and elapsed - self._told_at < _TELL_SECONDS:
            return
        self._told_at = elapsed
        fraction = min(1.0, max(self._fraction, elapsed / self.seconds))
        try:
            answer: Any = self._on_progress(
                PlanProgress(self._stage, elapsed, fraction, self._best, self._leader)
            )
        except BaseException as error:
            # kept for the caller: planning would take it for a mistake in the problem
            self.error = error
            answer = False
        self._is_ended = answer is False
