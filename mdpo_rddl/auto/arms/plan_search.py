"""The arm that evolves an open-loop plan on the exact model."""

import math
from dataclasses import dataclass

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.plan_population import PLAN
from mdpo_rddl.errors import Cancelled, note_heard


@dataclass(frozen=True)
class Evolving:
    """Which plan is evolved, and when that ends.

    Attributes:
      begins_with_noop: whether from the no-op, and only as long as the best policy so far seems
        within reach; else from the best policy so far.
      restarting: whether to begin again where nothing more is gained.
      label: of what is found.
    """

    begins_with_noop: bool = True
    restarting: bool = True
    label: str = PLAN


class PlanArm(ArenaArm):
    """Evolves a plan; the policy's other parameters stay."""

    def __init__(self, name: str, arena: Arena, evolving: Evolving) -> None:
        """Compiles nothing yet.

        Args:
          name: for people.
          arena: what all arms have in common; its policy has a plan.
          evolving: which plan, and until when.
        """
        super().__init__(name, arena)
        self._evolving = evolving

    def _work(self, until: float) -> None:
        """Evolves a plan.

        Raises:
          Cancelled: if interrupted; the best plan till then is offered.
        """
        arena, evolving = self._arena, self._evolving
        parent = None if evolving.begins_with_noop else arena.incumbent
        params = arena.noop if parent is None else parent.params
        until = arena.after_plans_compile(params, until)
        incumbent_return = -math.inf if parent is not None else arena.judge.best_mean
        noop = arena.noop_return
        goal = arena.plans.goal(until, noop, incumbent_return, evolving.restarting)
        before = arena.plans.iterations
        try:
            params = arena.plans.evolved(params, goal)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            if (found := arena.plans.elites) is not None:
                best = arena.plans.with_plan(params, found[0])
                self._offer_child(parent, evolving.label, best)
            raise
        self._log.iterations += arena.plans.iterations - before
        self._offer_child(parent, evolving.label, params)
