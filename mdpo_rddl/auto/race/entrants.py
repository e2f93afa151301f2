"""Which arms that must compile a program take part in a race."""

import logging
from collections.abc import Sequence

import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.arms.gradient import GRADIENT, GradientArm
from mdpo_rddl.auto.arms.policy_iteration import GREEDY, PolicyIterationArm
from mdpo_rddl.auto.arms.shooting import SHOOTING, ShootingArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.race.affording import Affording
from mdpo_rddl.planner.plans.single_changes import SingleChanges

logger = logging.getLogger(__name__)

# of the no-op, that the greedy policy tries at each decision
_MOST_CHANGES = 256
# of the states of one of its rollouts: a thousand are kept
_MOST_BYTES = 2**18


class Entrants:
    """Makes the arms that are wanted and that there is time for."""

    def __init__(self, arena: Arena, affording: Affording, without: Sequence[str]) -> None:
        """Makes none yet.

        Args:
          arena: where the arms meet.
          affording: says what there is time for.
          without: names of arms that are left out.
        """
        self._arena, self._affording, self._without = arena, affording, without

    def greedy(self, until: float, share: float) -> PolicyIterationArm | None:
        """The one that learns a value from exact rollouts.

        Args:
          until: how long its first part is to last, by the clock.
          share: of the time left, that its compilation and its first iterations may take.
        """
        if not self.may_be_greedy(share):
            return None
        affording = self._affording
        usual, jit = affording.usual_seconds(GREEDY), affording.value_jit()
        return PolicyIterationArm(self._arena, until, usual, jit, affording.batch_seconds)

    def may_be_greedy(self, share: float, later: float = 0.0) -> bool:
        """Whether there is such an arm, and time for it.

        Args:
          share: as `greedy` takes it.
          later: seconds from now, at which it would begin.
        """
        changes = self._changes
        if changes is None:
            return False
        # bools are tried side by side, and those together that affect nothing in common
        in_turn = changes.size if self.decides_numbers else 0
        return self._affording.value(share, in_turn, later)

    @property
    def decides_numbers(self) -> bool:
        """Whether some action is no bool."""
        rddl = self._arena.planner.rddl
        return any(rddl.variable_ranges[name] != "bool" for name in rddl.action_fluents)

    @property
    def has_numbers(self) -> bool:
        """Whether some action is no bool, or some state fluent a number."""
        rddl = self._arena.planner.rddl
        ranges = {rddl.variable_ranges[name] for name in rddl.state_fluents}
        return self.decides_numbers or not ranges.isdisjoint(("int", "real"))

    @property
    def _changes(self) -> SingleChanges | None:
        """What can be tried at a decision; None if that is too much, or the states are."""
        planner = self._arena.planner
        rddl, exact = planner.rddl, planner.test_compiled
        if GREEDY in self._without or rddl.observ_fluents:
            return None
        if planner.lose_on_error:
            return None  # what is learnt does not know where the environment raises one
        if self.decides_numbers and self._arena.probe.deterministic:
            return None  # no policy returns more than the best plan then
        changes = SingleChanges.of(exact)
        if changes is None or changes.size > _MOST_CHANGES:
            return None
        state = sum(np.asarray(exact.init_values[name]).nbytes for name in rddl.state_fluents)
        return changes if state * planner.horizon <= _MOST_BYTES else None

    def straight_line(self, until: float) -> CompilingArm | None:
        """The one that comes first where no policy returns more than the best plan does.

        That is so where chance plays no part; a gradient needs actions that are all real.

        Args:
          until: how long it may work, by the clock.
        """
        if not self.may_shoot(until):
            return None
        return ShootingArm(self._arena, self._affording.usual_seconds(SHOOTING))

    def may_shoot(self, until: float) -> bool:
        """Whether there is such an arm, and time for it; the argument is of `straight_line`."""
        ranges = self._arena.planner.rddl.variable_ranges
        kinds = {ranges[name] for name in self._arena.planner.rddl.action_fluents}
        is_possible = self._arena.probe.deterministic and kinds == {"real"}
        if not is_possible or SHOOTING in self._without:
            return False
        return self._affording.gradient(SHOOTING, until, comes_first=True)

    def has_rival(self, best: Candidate) -> bool:
        """Whether an arm with a gradient may find more than the best policy so far."""
        # where that is a plan and chance plays no part, no policy that sees the states can, and
        # the gradient on these is the same
        return best.arm != SHOOTING

    def gradient(
        self, until: float, arms: Sequence[Arm] = (), warns: bool = True
    ) -> CompilingArm | None:
        """The one on the feedback policy.

        Args:
          until: how long it may work, by the clock.
          arms: that take part already.
          warns: where there is too little time for it.
        """
        if GRADIENT in {*self._without, *(arm.name for arm in arms)}:
            return None
        if self._affording.gradient(GRADIENT, until):
            return GradientArm(self._arena, self._affording.usual_seconds(GRADIENT))
        if warns:
            left = until - self._arena.clock()
            logger.warning("there is too little time for the gradient: %.0f s are left", left)
        return None
