"""The arm that plays rules before anything but the probing's program is compiled."""

import logging

import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.arms.simple import SIMPLE
from mdpo_rddl.errors import one_line_cause

logger = logging.getLogger(__name__)

EARLY_RULE = "early rule"
# of the time left, and between which seconds
_SHARE, _SECONDS = 0.03, (0.5, 5.0)


class EarlyRulesArm(ArenaArm):
    """Offers a rule that returns more than the constants, by the program that has played these.

    It is there within seconds. No other arm knows of it, and it has nothing to keep up with: it is
    judged once the race is over, or came too late, and is the result if nothing better was found.
    """

    def __init__(self, arena: Arena) -> None:
        """Plays nothing yet."""
        super().__init__(SIMPLE, arena)

    def play(self) -> None:
        """Works for a small share of the time left, if there are rules that can be played."""
        arena, now = self._arena, self._clock()
        until = now + float(np.clip(_SHARE * (arena.deadline - now), *_SECONDS))
        probed = arena.probed
        # an error that is rare in play is seen in many rollouts only
        if probed is None or arena.problem.raises or not probed.has_time(until, self._clock):
            return
        self.work(until)

    def _work(self, until: float) -> None:
        arena, probe = self._arena, self._arena.probe
        assert arena.probed is not None
        try:
            found = arena.probed.best_rule((self.name, EARLY_RULE), arena.seed, until, self._clock)
        except Exception as error:  # the race goes on without it
            logger.info("no early rule: %s", one_line_cause(error))
            return
        if found.known_mean - found.error > max(probe.noop_return, probe.start_return):
            self._offer(found)
