"""The recipe of the preset `auto`: which arm works when.

Where all states can be enumerated, the optimum is known before any of this begins.

1. Constant actions on the exact model say in which units states and actions are of order 1.
2. The few weights that all objects share are adapted without a gradient on the exact return,
   which neither flat regions nor cliffs stop; then an open-loop plan, or each object's own
   weights if the plan does not promise to become as good.
3. MDPO follows the relaxed model's gradient from there and from the best constant action, with
   several step sizes side by side, in phases, each from the best policy so far.
4. Another search around the best policy corrects the relaxation error.
5. Meanwhile, in a second process, JaxPlan's default planners are trained.
6. The candidate of the largest return in fresh exact rollouts is the result.

Where no constant action and no random rule returns more than the no-op, 2 to 4 are a search for
a plan that explores.
"""

import dataclasses
import logging
from collections.abc import Callable, Sequence

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.arms.exploration import ExplorationArm
from mdpo_rddl.auto.arms.gradient import GradientArm
from mdpo_rddl.auto.arms.own_weights import Around, OwnWeightsArm
from mdpo_rddl.auto.arms.plan_search import Evolving, PlanArm
from mdpo_rddl.auto.arms.shared_weights import SHARED_WEIGHTS, SharedWeightsArm
from mdpo_rddl.auto.arms.simple import CONSTANT, RANDOM_RULE, SIMPLE, SimpleArm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.config.search_section import Search as Shares

logger = logging.getLogger(__name__)

_POLISHED, _POLISHING_SIGMA = "polished", 0.01
# of the time for the shared weights: random rules
_RULES_SHARE = 0.25
# a search of a large problem evaluates at least so many policies
_FEWEST_POLICIES = 60
# the gradient's program takes longer to compile than the population's, and an iteration longer
# than the rollouts of one population
_GRADIENT_COMPILATIONS, _GRADIENT_EVALUATIONS = 6.0, 100.0
_PHASES = 3
# of the gradient's time: the first phase compiles the program of all
_FIRST_SHARE = 0.5
_SHORTEST_SECONDS = 0.5
# of the time after the gradient's: its last call, or the compilation, may be late
_OVERRUN = 0.3


class Recipe:
    """The order of the arms and their shares of the time.

    Attributes:
      arms: those that were given any time, in the order in which they began.
      random_return: mean return of random actions; None if it was not measured.
    """

    def __init__(
        self,
        arena: Arena,
        shares: Shares,
        on_stage: Callable[[str], None],
        initial: Sequence[Candidate] = (),
    ) -> None:
        """Does nothing yet.

        Args:
          arena: where the arms meet.
          shares: of the time.
          on_stage: called with the name of each part as it begins.
          initial: policies to begin with, judged after the no-op and the best constant.
        """
        self._initial = initial
        self._arena, self._shares, self._on_stage = arena, shares, on_stage
        self._judge = arena.judge
        self.arms: list[Arm] = []
        self.random_return: float | None = None

    def run(self) -> None:
        """Gives every arm its slices, as far as there is time."""
        arena, judge = self._arena, self._judge
        if self._is_too_slow():
            logger.warning("there is too little time to search: a rollout takes so long")
            constant = arena.candidate(SIMPLE, CONSTANT, arena.constant)
            judge.record(dataclasses.replace(constant, mean=arena.probe.start_return))
            return
        simple = SimpleArm(arena)
        self.give(simple, arena.clock())
        for candidate in self._initial:
            judge.record(candidate)
        self._on_stage("searching")
        if arena.has_plan:
            self.random_return = arena.plans.random_return(arena.noop)
        self.give(simple, arena.until(_RULES_SHARE * self._shares.shared_until))
        shared = SharedWeightsArm(arena, self._first_rule())
        if arena.has_plan and judge.best_mean <= arena.plans.return_to_beat:
            self._explore(shared)
        else:
            self._improve(shared)

    def _first_rule(self) -> str:
        """Label of the rule that the search for shared weights begins with."""
        best = self._arena.incumbent.label
        return best if best in [candidate.label for candidate in self._initial] else RANDOM_RULE

    def give(self, arm: Arm, until: float) -> bool:
        """Gives an arm a slice of time and judges what it finds.

        Returns:
          Whether one of its candidates became the incumbent.

        Raises:
          KeyboardInterrupt: if interrupted, once what was found till then was judged.
        """
        if arm not in self.arms:
            self.arms.append(arm)
        try:
            arm.work(until)
        except (KeyboardInterrupt, Cancelled):
            self._judge_candidates(arm)
            raise
        return self._judge_candidates(arm)

    def _judge_candidates(self, arm: Arm) -> bool:
        is_better = False
        for candidate in arm.take_candidates():
            is_better |= self._judge.record(candidate)
            arm.judged(self._judge.judged[-1].candidate)
        return is_better

    def _is_too_slow(self) -> bool:
        seconds = self._arena.probe.policy_seconds
        left = self._arena.deadline - self._arena.clock()
        return seconds is not None and seconds * _FEWEST_POLICIES > left

    def _explore(self, shared: SharedWeightsArm) -> None:
        """For problems in which neither a constant nor a random rule beats the no-op.

        Where no return is larger nearby there is no gradient to follow either.
        """
        arena, judge, plans = self._arena, self._judge, self._arena.plans
        exploration = ExplorationArm(arena)
        has_plan = self.give(exploration, arena.until(self._shares.own_until))
        if judge.best_mean <= plans.return_to_beat or not plans.deterministic:
            has_plan &= not self.give(shared, arena.until(self._shares.shared_until))
        self._on_stage("polishing")
        if judge.best_mean <= plans.return_to_beat:
            self.give(exploration, arena.deadline)
        else:
            self._polish(has_plan, restarting=False)

    def _improve(self, shared: SharedWeightsArm) -> None:
        """For problems in which a constant or a random rule beats the no-op."""
        arena, shares = self._arena, self._shares
        parts = shares.shared_until, shares.own_until, shares.gradient_until
        shared_until, own_until, gradient_until = (arena.until(share) for share in parts)
        self.give(shared, shared_until)
        has_plan = arena.has_plan and self.give(PlanArm("plan", arena, Evolving()), own_until)
        if not has_plan:
            around = Around(begins_with=SHARED_WEIGHTS)
            self.give(OwnWeightsArm("own weights", arena, around), own_until)
        if self._has_time_for_the_gradient(gradient_until):
            self._on_stage("compiling")
            self._follow_the_gradient(gradient_until)
        self._on_stage("polishing")
        self._polish(has_plan, restarting=True)

    def _polish(self, has_plan: bool, restarting: bool) -> None:
        """Around the best policy: its plan, if that is what made it the best, or its weights."""
        arena = self._arena
        arm: Arm
        if has_plan:
            evolving = Evolving(False, restarting, _POLISHED)
            arm = PlanArm("polishing the plan", arena, evolving)
        else:
            around = Around(None, _POLISHING_SIGMA, _POLISHED)
            arm = OwnWeightsArm("polishing the weights", arena, around)
        self.give(arm, arena.deadline)

    def _follow_the_gradient(self, until: float) -> None:
        arena = self._arena
        arm = GradientArm(arena, given_up_at=until + _OVERRUN * (arena.deadline - until))
        for phase in range(_PHASES):
            left = until - arena.clock()
            seconds = left / (_PHASES - phase) if phase else _FIRST_SHARE * left
            if seconds < _SHORTEST_SECONDS or arm.has_failed:
                break
            self.give(arm, arena.clock() + seconds)

    def _has_time_for_the_gradient(self, until: float) -> bool:
        population = self._arena.population
        needed = _GRADIENT_COMPILATIONS * population.compile_seconds
        needed += _GRADIENT_EVALUATIONS * population.seconds
        left = until - self._arena.clock()
        if self._arena.probe.policy_seconds is not None or needed > left:
            logger.warning("there is too little time for the gradient: %.0f s are left", left)
            return False
        return True
