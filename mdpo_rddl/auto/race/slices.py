"""Slices of time: who is given one, and what becomes of what is found in it."""

import logging
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import FIRST_SLICES, Arm
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.gains import finite_gain
from mdpo_rddl.auto.outcome.failures import incumbent_kept
from mdpo_rddl.auto.race.rounds import Contender, Reached, raising
from mdpo_rddl.errors import Cancelled, note_heard, one_line_cause

logger = logging.getLogger(__name__)

SHORTEST_SECONDS = 0.5
"""Of a slice."""
# of all the time: a slice; and each of an arm's first ones, of a slice
_SLICE_SHARE, _FIRST_SLICE = 1 / 16, 0.5
# of the time left, for the programs of those that come first
_FIRST_PATIENCE = 0.9


@dataclass(frozen=True)
class Terms:
    """On which an arm has slices before others.

    Attributes:
      until: when the last of them ends, by the clock.
      least_gain: says which share of what the first slice has gained each must gain.
      at_least: says of the time left, after the first slice, for another one that it has whatever
        the first one gains.
      by_policies: says whether the best policy must return more each time; else the arm's
        progress.
    """

    until: float
    least_gain: Callable[[], float] = lambda: 0.0
    at_least: Callable[[], float] = lambda: 0.0
    by_policies: Callable[[], bool] = lambda: False


class Slices:
    """Gives arms their slices.

    Attributes:
      arms: those that were given any time, in the order in which they began.
    """

    def __init__(
        self,
        arena: Arena,
        on_stage: Callable[[str], None],
        without: Collection[str] = (),
    ) -> None:
        """Gives nothing yet.

        Args:
          arena: where the arms meet.
          on_stage: called with the name of each part as it begins.
          without: names of arms that get none.
        """
        self._arena, self._on_stage, self._judge = arena, on_stage, arena.judge
        self._without = without
        self.arms: list[Arm] = []
        self._contenders: list[Contender] = []

    def give(self, arm: Arm, until: float) -> bool:
        """Gives an arm a slice of time and judges what it finds.

        There is none once the race is over, and for an arm that is left out.

        Returns:
          Whether one of its candidates became the incumbent.

        Raises:
          KeyboardInterrupt: if interrupted, once what was found till then was judged.
        """
        if arm.name in self._without:
            arm.is_exhausted = True
            return False
        is_over = self._arena.clock() >= max(until, self._arena.deadline)
        if is_over and self._judge.incumbent is not None:
            return False
        self._enter(arm)
        try:
            arm.work(until)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            self._judge_candidates(arm)
            raise
        except Exception as error:  # the other arms find a policy without this one
            if self._judge.incumbent is None:
                raise
            logger.warning("%s is given up: %s", arm.name, one_line_cause(error))
            arm.is_exhausted = True
        return self._judge_candidates(arm)

    def _enter(self, arm: Arm) -> None:
        """An arm takes part."""
        if arm not in self.arms:
            self.arms.append(arm)

    def _contend(self, arm: Arm, reached: Callable[[], float | None], slices: int = 0) -> Contender:
        """Has an arm take part in the rounds; the arguments are those of `Contender`."""
        contender = Contender(arm, reached, slices)
        if arm.name in self._without:
            arm.is_exhausted = True
            return contender
        self._enter(arm)
        self._contenders.append(contender)
        return contender

    def _judge_given(self, candidates: Iterable[Candidate]) -> None:
        """Judges candidates; where there is an incumbent, what comes too late is left out."""
        with incumbent_kept(self._judge):
            for candidate in candidates:
                self._judge.record(candidate)

    def _judge_candidates(self, arm: Arm) -> bool:
        """Judges what an arm has found; if it is interrupted, the rest that takes no compilation.

        Raises:
          KeyboardInterrupt: if interrupted; `Cancelled` likewise.
        """
        waiting = arm.take_candidates()
        is_better = False
        try:
            while waiting:
                is_better |= self._judge_one(arm, waiting.pop(0))
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            for candidate in filter(self._judge.is_ready, waiting):
                self._judge_one(arm, candidate)
            raise
        return is_better

    def _judge_one(self, arm: Arm, candidate: Candidate) -> bool:
        is_better = False
        with incumbent_kept(self._judge):
            is_better = self._judge.record(candidate)
            arm.judged(self._judge.judged[-1].candidate)
        return is_better

    def _open(self, arm: CompilingArm, until: float, patience: float) -> Contender:
        """Lets an arm that must compile begin; it competes from then on.

        Args:
          arm: that has not begun.
          until: when its first slice ends at the latest, if it has one now.
          patience: how long its compilation is waited for, by the clock.
        """
        arena = self._arena
        self._on_stage("compiling")
        reached = (lambda: arena.incumbent.mean) if arm.descends else (lambda: arm.reached)
        contender = self._contend(arm, reached)
        if not arm.is_exhausted:
            arm.begin(patience)
        if not (arm.is_exhausted or arm.is_pending):
            self._give_slice(contender, until)
        return contender

    def _first_slice(self, contender: Contender, until: float) -> None:
        """Waits for a compilation, and gives the arm its first slice if that ends in time."""
        contender.arm.await_program(until)
        if not contender.arm.is_pending:
            self._give_slice(contender, until)

    def _give_slice(self, contender: Contender, until: float) -> None:
        arena = self._arena
        before, started = contender.reached(), arena.clock()
        share = _FIRST_SLICE if contender.slices < FIRST_SLICES else 1.0
        self.give(contender.arm, min(started + share * self._slice_seconds, until))
        contender.note(before, arena.clock() - started)
        for other in self._contenders:
            other.waited = 0 if other is contender else other.waited + 1

    def _end_with(self, leader: Arm) -> None:
        """Gives an arm the time till the deadline."""
        while self._arena.clock() < self._arena.deadline and not leader.is_exhausted:
            self.give(leader, self._arena.deadline)

    @property
    def _slice_seconds(self) -> float:
        arena = self._arena
        return max(SHORTEST_SECONDS, _SLICE_SHARE * arena.seconds)

    def _give_while(
        self, one: Contender, until: float, reached: Reached, by: Reached = lambda: 0.0
    ) -> None:
        """Slices for one arm, as long as each of them raises a return by more than that."""
        for _ in raising(reached, by):
            # what plays its policies may be compiled still, and nothing is gained before
            one.arm.await_program(min(until, self._arena.clock() + self._slice_seconds))
            if one.arm.is_exhausted or until - self._arena.clock() <= SHORTEST_SECONDS:
                break
            self._give_slice(one, until)

    @property
    def _best(self) -> Candidate:
        best = self._judge.incumbent
        assert best is not None
        return best

    def _to_catch_up(self, arm: Arm, until: float) -> float:
        """What each slice till then must gain for an arm to reach the incumbent of another one."""
        if self._best.arm == arm.name:
            return 0.0
        slices = max(1.0, (until - self._arena.clock()) / self._slice_seconds)
        return max(0.0, (self._judge.best_mean - arm.progress) / slices)

    def _begin_with(self, arm: CompilingArm, terms: Terms) -> None:
        """Slices before others', while they gain.

        Each must gain enough for the arm to reach the incumbent of another one in time.

        Args:
          arm: that must compile.
          terms: on which it has them.
        """
        arena, until = self._arena, terms.until
        patience = arena.until(_FIRST_PATIENCE)
        contender = self._open(arm, until, arena.clock())
        if arm.is_pending or not contender.slices:
            self._first_slice(contender, patience)
        if not contender.slices:
            return
        gain = finite_gain(contender.level, arena.probe.noop_return)

        def least() -> float:
            return max(terms.least_gain() * gain, self._to_catch_up(arm, until))

        if (at_least := terms.at_least()) and not arm.is_exhausted:
            self.give(arm, min(until, arena.until(at_least)))
        level, progress = (lambda: contender.level), (lambda: arm.progress)
        self._give_while(contender, until, level if terms.by_policies() else progress, least)
