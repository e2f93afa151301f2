"""How a session gets on, as a bar in a terminal or a notebook."""

from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from mdpo_rddl.planner.training import Progress as TrainingProgress


class ProgressBar:
    """A reporter that draws a progress bar on standard error; for use in a `with` block."""

    def __init__(self, shown: bool | None = None) -> None:
        """Draws nothing yet.

        Args:
          shown: whether to draw; if None in a terminal and in a notebook only.
        """
        console = Console(stderr=True)
        if shown is None:
            shown = console.is_terminal or console.is_jupyter
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description:<10}"),
            BarColumn(bar_width=30),
            TextColumn("{task.percentage:>3.0f}%"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[note]}"),
            console=console,
            disable=not shown,
        )
        self._task: Any = None
        self._stage = ""

    def __enter__(self) -> "ProgressBar":
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
        self._task = self._bar.add_task(name, total=None, note="")

    def training(self, progress: TrainingProgress) -> None:
        """Moves the bar of the training stage, which follows compilation by itself."""
        if self._stage != "training":
            self.stage("training")
        self._bar.update(
            self._task,
            total=1.0,
            completed=progress.fraction,
            note=f"iteration {progress.iteration + 1:,}  test {progress.test_return:,.0f}"
            f"  best {progress.best_return:,.0f}",
        )

    def episode(self, done: int, of: int) -> None:
        """Moves the bar of the evaluation stage."""
        self._bar.update(self._task, total=of, completed=done, note=f"episode {done} of {of}")

    def _finish(self) -> None:
        if self._task is not None:
            total = self._bar.tasks[-1].total or 1.0
            self._bar.update(self._task, total=total, completed=total)
