"""What a race is given beside the problem and the configuration."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mdpo_rddl.auto.arena.arena import UNLIMITED, Arena
from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.auto.common.curve import Curve
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.resuming.earlier import EarlierRace
from mdpo_rddl.planner.training.training import Progress


def _ignore_stage(name: str) -> None:
    del name


def _ignore_progress(progress: Progress) -> None:
    del progress


def _ignore_judged(judged: Judged) -> None:
    del judged


def _no_candidates(arena: Arena) -> Sequence[Candidate]:
    del arena
    return ()


def _ignore_used(used: Clock) -> None:
    del used


def _ignore_pulse() -> None:
    pass


@dataclass(frozen=True)
class RaceOptions:
    """What a race is given beside the problem and the configuration.

    Attributes:
      traced_cache: where traced programs are kept from one process to the next, if anywhere.
      on_stage: called with the name of each part as it begins.
      on_progress: called while a training with a gradient goes on.
      on_judged: called with each candidate once the judge has played it.
      initial: given the arena, policies to begin with, judged after the no-op and the best
        constant.
      clock: what everybody asks for the time.
      most_iterations: of one training with a gradient.
      earlier: what a race that was stopped has left, whose seconds count as used.
      on_begun: given what says how many seconds the race has used, those of earlier processes
        included.
      on_pulse: called between two iterations of whichever arm works, and before a part that has
        none.
      at_the_latest: when the race ends, by the clock, if the judge's program would come too late in
        its own time.
    """

    traced_cache: Path | None = None
    on_stage: Callable[[str], None] = _ignore_stage
    on_progress: Callable[[Progress], None] = _ignore_progress
    on_judged: Callable[[Judged], None] = _ignore_judged
    initial: Callable[[Arena], Sequence[Candidate]] = _no_candidates
    clock: Clock = time.monotonic
    most_iterations: int = UNLIMITED
    earlier: EarlierRace | None = None
    on_begun: Callable[[Clock], None] = _ignore_used
    on_pulse: Callable[[], None] = _ignore_pulse
    at_the_latest: float = -math.inf

    @property
    def earlier_curve(self) -> Curve:
        """The candidates of earlier processes."""
        return () if self.earlier is None else self.earlier.curve
