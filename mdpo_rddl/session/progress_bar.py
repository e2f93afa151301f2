"""How a session gets on: as a bar in a terminal, else as a line now and then."""

import sys
import time
from threading import Event, Thread
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from mdpo_rddl.problem.evaluation import LOST
from mdpo_rddl.session.requests import Incumbent

TRAINING = "training"

# lines where there is no terminal: a log that says nothing looks like a process that hangs, as
# while a model is compiled; what is wrong at once stays the only line
_FIRST_LINE_AFTER = 1.0
_SECONDS_OF_A_LINE = 30.0

# between two looks of a race's bar
_RACING_SECONDS = 0.1

if TYPE_CHECKING:  # which imports JAX
    from mdpo_rddl.planner.training.training import Progress as TrainingProgress


class ProgressBar:
    """A reporter that draws a progress bar on standard error; for use in a `with` block.

    Where standard error is no terminal it writes a line at the start, and one every 30 seconds.
    """

    def __init__(self, shown: bool | None = None) -> None:
        """Draws nothing yet.

        Args:
          shown: whether to draw; if None in a terminal only.
        """
        console = Console(stderr=True)
        if shown is None:
            shown = console.is_terminal
        self._is_told = shown and not console.is_terminal
        self._is_over = Event()
        self._teller = Thread(target=self._tell, daemon=True)
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description:<10}"),
            BarColumn(bar_width=30),
            TextColumn("{task.percentage:>3.0f}%"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[note]}"),
            # older versions of rich end with a line even where they have shown nothing
            console=console if shown else Console(quiet=True),
            disable=not shown,
        )
        self._task: Any = None
        self._stage = ""
        self._incumbent: str | None = None
        self._moved_at = -float("inf")

    def __enter__(self) -> "ProgressBar":
        self._bar.start()
        if self._is_told:
            self._teller.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._is_over.set()
        if error is None:
            self._bar.stop()
            return
        # what went wrong is all that there is to say
        self._bar.live.transient = True
        self._bar.live.stop()

    def stage(self, name: str) -> None:
        """Starts a new bar under the finished ones."""
        self._finish()
        self._stage = name
        self._task = self._bar.add_task(name, total=None, note=self._incumbent or "")

    def say(self) -> bool:
        """Writes a line of the stage and the time that it has taken so far, if there is one."""
        if self._task is None:
            return False
        task = self._bar.tasks[-1]
        words = [self._stage, f"{task.elapsed or 0.0:.0f} s", " ".join(task.fields["note"].split())]
        sys.stderr.write(f"mdpo-plan: {', '.join(filter(None, words))}\n")
        sys.stderr.flush()
        return True

    def _tell(self) -> None:
        seconds = _FIRST_LINE_AFTER
        while not self._is_over.wait(seconds):
            seconds = _SECONDS_OF_A_LINE if self.say() else _FIRST_LINE_AFTER

    def training(self, progress: "TrainingProgress") -> None:
        """Moves the bar of the training stage, which follows compilation by itself."""
        if self._incumbent is not None:  # one of several arms; the stage is the race's
            self._bar.update(self._task, total=1.0, completed=progress.fraction)
            return
        # the first report is of the first call's last iteration, whichever that is
        if self._stage != TRAINING:
            self.stage(TRAINING)
        self._bar.update(
            self._task,
            total=1.0,
            completed=progress.fraction,
            note=f"iteration {progress.iteration + 1:,}  test {progress.test_return:z,.0f}"
            f"  best {progress.best_return:z,.0f}",
        )

    def racing(self, fraction: float) -> None:
        """Moves the bar of a race."""
        now = time.monotonic()
        if self._task is not None and now - self._moved_at >= _RACING_SECONDS:
            self._moved_at = now
            self._bar.update(self._task, total=1.0, completed=fraction)

    def incumbent(self, found: Incumbent) -> None:
        """Shows the best policy of a race, and which arm leads."""
        told = "lost" if found.mean <= LOST else f"{found.mean:z,.0f}"
        self._incumbent = f"best {told} by {found.arm}"
        if self._task is not None:  # else the first stage shows it
            self._bar.update(self._task, note=self._incumbent)

    def episode(self, done: int, of: int) -> None:
        """Moves the bar of the evaluation stage."""
        self._bar.update(self._task, total=of, completed=done, note=f"episode {done} of {of}")

    def _finish(self) -> None:
        if self._task is not None:
            total = self._bar.tasks[-1].total or 1.0
            self._bar.update(self._task, total=total, completed=total)
