"""The arm that explores: for problems in which a reward must first be found."""

import math

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.archive import Archive
from mdpo_rddl.auto.search.plan_population import PLAN
from mdpo_rddl.errors import Cancelled, note_heard
from mdpo_rddl.planner.plans.feedback import Params


class ExplorationArm(ArenaArm):
    """Evolves a plan; until one beats the no-op, half of the plans go where none has been.

    Each slice goes on with the plan and the archive of the last.
    """

    def __init__(self, arena: Arena) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common; its policy has a plan.
        """
        super().__init__("exploration", arena)
        self._params: Params = arena.noop
        self._archive: Archive | None = None

    def _prepare(self) -> None:
        self._archive = self._arena.plans.archive(self._params)

    def _work(self, until: float) -> None:
        """Evolves a plan.

        Raises:
          Cancelled: if interrupted; the best plan till then is offered.
        """
        plans = self._arena.plans
        before = plans.iterations
        until = self._arena.after_plans_compile(self._params, until)
        goal = plans.goal(until, self._arena.noop_return, -math.inf, restarting=False)
        try:
            self._params = plans.evolved(self._params, goal, self._archive)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            if plans.elites is not None:
                self._offer_plan(plans.with_plan(self._params, plans.elites[0]))
            raise
        self._log.iterations += plans.iterations - before
        self._log.details = {"cells": 0 if self._archive is None else len(self._archive)}
        self._offer_plan(self._params)

    def _offer_plan(self, params: Params) -> None:
        self._offer_child(None, PLAN if self._log.slices == 1 else "polished", params)
