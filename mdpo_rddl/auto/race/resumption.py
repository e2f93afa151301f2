"""How a race enters where another one was stopped, and what it leaves for the next."""

import logging
from collections.abc import Callable, Sequence

from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.state import UNFIT, State
from mdpo_rddl.auto.race.rounds import Contender
from mdpo_rddl.auto.resuming.marks import Marks
from mdpo_rddl.auto.resuming.race_state import RaceState
from mdpo_rddl.errors import one_line_cause

logger = logging.getLogger(__name__)

Snapshot = Callable[[], RaceState]
"""Says where the race is now."""


class Resumption:
    """Hands the arms of a race what those of an earlier race have left.

    Attributes:
      marks: which parts of the race are over.
      probe: what probing found; None before that.
    """

    def __init__(self, seconds: Callable[[], float], earlier: RaceState | None = None) -> None:
        """Nothing is handed out yet.

        Args:
          seconds: says how many the race has used.
          earlier: where the earlier race was, whose states are taken out as their arms begin;
            None for a race that begins.
        """
        self._seconds = seconds
        self._earlier = RaceState(0.0) if earlier is None else earlier
        self.marks, self.probe = Marks(self._earlier.marks), self._earlier.probe
        self._arms: dict[str, Arm] = {}
        self._contenders: dict[str, Contender] = {}

    def enter(self, arm: Arm) -> None:
        """Gives an arm, before its first slice, the time and the state that it had; once."""
        earlier = self._earlier
        if arm.name in self._arms:
            return
        self._arms[arm.name] = arm
        if (log := earlier.logs.get(arm.name)) is not None:
            arm.take_over(log, arm.name in earlier.exhausted)
        # it may be large: the arm has it from here on
        if (state := earlier.states.pop(arm.name, None)) is None:
            return
        try:
            arm.restore(state)
        except UNFIT as error:
            cause = one_line_cause(error)
            logger.info("%s: its state is left out: %s", arm.name, cause)

    def contend(self, contender: Contender) -> None:
        """Gives a contender the pace that its arm had in the rounds."""
        found = self._earlier.contenders.get(contender.arm.name)
        self._contenders[contender.arm.name] = contender
        if found is not None:
            contender.slices, contender.waited = int(found["slices"]), int(found["waited"])
            contender.pace = found["pace"]

    def goes_on(self, name: str) -> bool:
        """Whether an arm of the earlier race had more to find."""
        return name in self._earlier.logs and name not in self._earlier.exhausted

    def left_out(self, arms: Sequence[Arm]) -> list[ArmLog]:
        """The logs of an earlier race's arms that have not begun in this one."""
        names = {arm.name for arm in arms}
        return [log for name, log in self._earlier.logs.items() if name not in names]

    def snapshot(self) -> RaceState:
        """Where the race is now; what nobody has taken over stays."""
        earlier, arms = self._earlier, self._arms
        contenders = {
            name: {"slices": one.slices, "pace": one.pace, "waited": one.waited}
            for name, one in self._contenders.items()
        }
        exhausted = {name for name in earlier.exhausted if name not in arms}
        exhausted |= {name for name, arm in arms.items() if arm.is_over}
        states = dict(earlier.states)
        for name, arm in arms.items():
            if (state := _state_of(arm)) is not None:
                states[name] = state
        return RaceState(
            seconds=self._seconds(),
            marks=self.marks.values(),
            contenders={**earlier.contenders, **contenders},
            logs={**earlier.logs, **{name: arm.log_so_far for name, arm in arms.items()}},
            exhausted=frozenset(exhausted),
            states=states,
            probe=self.probe,
        )


def _state_of(arm: Arm) -> State | None:
    """An arm's state; one that cannot be told costs the arm's state, not the race."""
    try:
        return arm.state()
    except Exception as error:
        logger.warning("%s: its state is not kept: %s", arm.name, one_line_cause(error))
        return None
