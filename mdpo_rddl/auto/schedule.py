"""The race of the preset `auto`: who works when.

Where all states can be enumerated, the optimum is known before any of this begins; where they
can't, but the rules were grounded, a search by trials has gone ahead.

1. Constant actions on the exact model say in which units states and actions are of order 1.
2. The arms begin in the order of what they cost: `ppo`, where all actions are bools; `pgpe`; the
   weights that all objects share; an open-loop plan, or each object's own weights; and those that
   need the model's gradient, as far as there is time to compile them; but where chance plays no
   part, a straight-line plan is second.
3. Rounds: each slice of time goes to the arm that promises to gain most, by its latest pace, and
   one in eight to the one that has waited longest (`rounds.py`).
4. Another search around the best policy corrects the relaxation error.

Where no constant and no random rule returns more than the no-op, a search for a plan that explores
comes first. JaxPlan's default planners are trained meanwhile, in a second process.
"""

import logging
from collections.abc import Callable, Sequence
from functools import cached_property

from mdpo_rddl.auto.affording import PATIENCE, Affording
from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import Arm, CompilingArm
from mdpo_rddl.auto.arms.exploration import ExplorationArm
from mdpo_rddl.auto.arms.gradient import GRADIENT
from mdpo_rddl.auto.arms.own_weights import Around, OwnWeightsArm
from mdpo_rddl.auto.arms.plan_search import Evolving, PlanArm
from mdpo_rddl.auto.arms.shared_weights import SHARED_WEIGHTS, SharedWeightsArm
from mdpo_rddl.auto.arms.simple import RANDOM_RULE, SimpleArm
from mdpo_rddl.auto.arms.training import METHODS
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.entrants import Entrants
from mdpo_rddl.auto.polishing import polishing_arm
from mdpo_rddl.auto.rounds import FIRST_SLICES, Contender, Reached, next_contender, raising
from mdpo_rddl.auto.unsearched import known_without_rollouts
from mdpo_rddl.errors import Cancelled, one_line_cause
from mdpo_rddl.planner.config.search_section import Search as Shares

logger = logging.getLogger(__name__)

# random rules, of the time for the shared weights; more of them, of the time left
_RULES_SHARE, _MORE_RULES_SHARE = 0.25, 0.1
# of the time left, for the exploration: before the other arms, and for these if it finds nothing;
# for ppo, while slices gain; for a straight-line plan, while they gain so much of the first's gain
_EXPLORATION_SHARE, _OTHERS_SHARE, _LEARNING = 0.45, 0.4, 0.6
_PLAN_SHARE, _LEAST_GAIN = 0.6, 0.02
# of the time left, at most, for an arm that needs no compilation, before the others
_EARLY_SHARE, _LESS = 0.3, 0.5
# of all the time: a slice; and each of an arm's first ones, of a slice
_SLICE_SHARE, _SHORTEST_SECONDS, _FIRST_SLICE = 1 / 16, 0.5, 0.5


class Schedule:
    """Which arm works when.

    Attributes:
      arms: those that were given any time, in the order in which they began.
      early: an arm that needs no compilation, to be tried before those that do.
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
          shares: of the time, and which arms are left out.
          on_stage: called with the name of each part as it begins.
          initial: policies to begin with, whoever found them.
        """
        self._arena, self._shares, self._on_stage = arena, shares, on_stage
        self._initial, self._judge, self._affording = initial, arena.judge, Affording(arena)
        self._entrants = Entrants(arena, self._affording, shares.without)
        self.arms: list[Arm] = []
        self.early: Arm | None = None
        self.random_return: float | None = None
        self._has_plan = False
        self._contenders: list[Contender] = []

    def run(self) -> None:
        """Gives arms their slices until the time is over."""
        arena, judge = self._arena, self._judge
        if not self._affording.search():
            self._end_with_constant()
            return
        simple = SimpleArm(arena)
        self.give(simple, arena.clock())
        for candidate in self._initial:
            judge.record(candidate)
        if self.early is not None:
            self._try_early(self.early, arena.until(_EARLY_SHARE))
        if not self._affording.population():
            logger.warning("there is too little time to search: compilation takes so long")
            if self.early is not None:
                self._end_with(self.early)
            return
        self._begin_with(self._entrants.learner(arena.until(_LEARNING)), _LEARNING)
        # before the population, whose program takes longer
        until = arena.until(self._shares.rounds_until)
        exploration = self._opened(self._entrants.exploration(), until)
        self._on_stage("searching")
        self.give(simple, arena.until(_RULES_SHARE * self._shares.shared_until))
        if arena.has_plan and self._affording.population():
            self.random_return = arena.plans.random_return(arena.noop)
        if exploration is not None and not exploration.slices:
            # what it finds decides what comes first
            self._first_slice(exploration, arena.until(PATIENCE))
        shared = SharedWeightsArm(arena, RANDOM_RULE)
        if not self._finds_reward():
            self.give(simple, arena.until(_MORE_RULES_SHARE))
        go_on = self._improve if self._finds_reward() else self._explore
        go_on(shared)

    def _end_with_constant(self) -> None:
        """Where a rollout takes too long for any search on the compiled model."""
        for candidate in known_without_rollouts(self._arena, self._initial):
            self._judge.record(candidate)
        if self.early is not None:
            self._try_early(self.early, self._arena.deadline)

    def _try_early(self, arm: Arm, until: float) -> None:
        """Slices for one that may have worked already, while each finds a better policy."""
        self.arms.append(arm)
        is_better = self._judge_candidates(arm)
        contender = Contender(arm, lambda: arm.reached)
        self._contenders.append(contender)
        self._on_stage("searching")
        if is_better:
            self._give_while(contender, until, lambda: self._judge.best_mean)

    def _give_while(self, one: Contender, until: float, reached: Reached, by: float = 0.0) -> None:
        """Slices for one arm, as long as each of them raises a return by more than that."""
        for _ in raising(reached, by):
            # what plays its policies may be compiled still, and nothing is gained before
            one.arm.await_program(min(until, self._arena.clock() + self._slice_seconds))
            if one.arm.is_exhausted or until - self._arena.clock() <= _SHORTEST_SECONDS:
                break
            self._give_slice(one, until)

    def _finds_reward(self) -> bool:
        """Whether there is a better policy than the no-op, or none is looked for."""
        return not self._arena.has_plan or self._beats_noop(self._arena.incumbent)

    def _beats_noop(self, candidate: Candidate) -> bool:
        return candidate.known_mean > self._arena.plans.return_to_beat

    def give(self, arm: Arm, until: float) -> bool:
        """Gives an arm a slice of time and judges what it finds; none once the race is over.

        Returns:
          Whether one of its candidates became the incumbent.

        Raises:
          KeyboardInterrupt: if interrupted, once what was found till then was judged.
        """
        is_over = self._arena.clock() >= max(until, self._arena.deadline)
        if is_over and self._judge.incumbent is not None:
            return False
        if arm not in self.arms:
            self.arms.append(arm)
        try:
            arm.work(until)
        except (KeyboardInterrupt, Cancelled):
            self._judge_candidates(arm)
            raise
        except Exception as error:  # the other arms find a policy without this one
            if self._judge.incumbent is None:
                raise
            logger.warning("%s is given up: %s", arm.name, one_line_cause(error))
            arm.is_exhausted = True
        return self._judge_candidates(arm)

    def _judge_candidates(self, arm: Arm) -> bool:
        is_better = False
        for candidate in arm.take_candidates():
            is_better |= self._judge.record(candidate)
            arm.judged(self._judge.judged[-1].candidate)
        return is_better

    def _explore(self, shared: SharedWeightsArm) -> None:
        """For problems in which neither a constant nor a random rule beats the no-op."""
        arena = self._arena
        exploration = ExplorationArm(arena)
        # less where a net has found something already
        share = _EXPLORATION_SHARE * (_LESS if self._beats_noop(self._best) else 1.0)
        self._search_plans(exploration, arena.until(share))
        if not self._beats_noop(arena.incumbent) or not arena.plans.deterministic:
            self.give(shared, arena.until(self._shares.shared_until))
            self._has_plan &= arena.incumbent.arm == exploration.name
        if not self._beats_noop(arena.incumbent):
            self._contenders.append(Contender(exploration, lambda: arena.incumbent.mean))
        found = self._beats_noop(self._best)
        rounds_until = arena.until(self._shares.rounds_until if found else _OTHERS_SHARE)
        self._open_programs(rounds_until, METHODS)
        self._compete(rounds_until, polishing=found)
        if self._beats_noop(self._best):
            self._finish()
        else:
            self._on_stage("polishing")
            self._end_with(exploration)

    @property
    def _best(self) -> Candidate:
        best = self._judge.incumbent
        assert best is not None
        return best

    def _improve(self, shared: SharedWeightsArm) -> None:
        """For problems in which a constant or a random rule beats the no-op."""
        arena, shares = self._arena, self._shares
        plan = self._entrants.straight_line(arena.until(shares.rounds_until))
        self._begin_with(plan, _PLAN_SHARE, _LEAST_GAIN)
        parts = shares.shared_until, shares.own_until, shares.rounds_until
        shared_until, own_until, rounds_until = (arena.until(share) for share in parts)
        self.give(shared, shared_until)
        if arena.has_plan:
            self._search_plans(PlanArm("plan", arena, Evolving()), own_until)
        if not self._has_plan:
            around = Around(begins_with=SHARED_WEIGHTS)
            self.give(OwnWeightsArm("own weights", arena, around), own_until)
        self._open_programs(rounds_until, (GRADIENT, *METHODS))
        self._compete(rounds_until)
        self._finish()

    def _search_plans(self, arm: Arm, until: float) -> None:
        """Whether its plan is the best feedback policy decides what is polished."""
        if self._arena.plans.is_compiled or self._affording.population():
            self.give(arm, until)
        self._has_plan = self._arena.incumbent.arm == arm.name

    def _opened(self, arm: CompilingArm | None, until: float) -> Contender | None:
        return None if arm is None else self._open(arm, until, self._affording.patience(until))

    def _open_programs(self, until: float, names: Sequence[str]) -> None:
        """Opens those arms with a gradient that are in the race and can be afforded."""
        patience = self._affording.patience(until)
        for arm in self._entrants.gradients(names, until, self.arms):
            self._open(arm, until, patience)

    def _begin_with(self, arm: CompilingArm | None, share: float, least_gain: float = 0.0) -> None:
        """Slices before others', while each gains such a share of what the first has gained."""
        arena, until = self._arena, self._arena.until(share)
        contender = self._opened(arm, arena.until(self._shares.rounds_until))
        if arm is None or contender is None:
            return
        if not contender.slices:
            self._first_slice(contender, arena.until(PATIENCE))
        if contender.slices:
            gain = abs(contender.level - arena.probe.noop_return)
            self._give_while(contender, until, lambda: arm.progress, least_gain * gain)

    def _open(self, arm: CompilingArm, until: float, patience: float) -> Contender:
        """Lets an arm that must compile begin; it competes from then on.

        Args:
          arm: that has not begun.
          until: when its first slice ends at the latest, if it has one now.
          patience: how long its compilation is waited for, by the clock.
        """
        arena = self._arena
        self._on_stage("compiling")
        self.arms.append(arm)
        arm.begin(patience)
        reached = (lambda: arena.incumbent.mean) if arm.descends else (lambda: arm.reached)
        contender = Contender(arm, reached)
        self._contenders.append(contender)
        if not arm.is_pending:
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

    @property
    def _slice_seconds(self) -> float:
        arena = self._arena
        return max(_SHORTEST_SECONDS, _SLICE_SHARE * (arena.deadline - arena.began))

    def _compete(self, until: float, polishing: bool = True) -> None:
        """Rounds of slices, each for the arm that promises most.

        Args:
          until: when they end.
          polishing: whether there is a policy that is worth a search around it.
        """
        arena, judge = self._arena, self._judge
        if polishing:
            self._contenders.append(Contender(self._polisher, lambda: arena.incumbent.mean))
        self._on_stage("racing")
        number = 0
        while (left := until - arena.clock()) > _SHORTEST_SECONDS:
            chosen = next_contender(self._contenders, number, judge.best_mean, left)
            if chosen is not None:
                self._give_slice(chosen, until)
                number += 1
                continue
            pending = [one.arm for one in self._contenders if one.arm.is_pending]
            if not pending:
                break
            pending[0].await_program(min(until, arena.clock() + _SHORTEST_SECONDS))

    def _finish(self) -> None:
        """The rest of the time is for whoever leads."""
        best = self._best
        self._on_stage("polishing")
        leader = next((arm for arm in self.arms if arm.name == best.arm), None)
        if best.planner is self._arena.planner or leader is None:
            leader = self._polisher
        self._end_with(leader)

    def _end_with(self, leader: Arm) -> None:
        """Gives an arm the time till the deadline, but for those that wait to be judged."""
        arena = self._arena
        while (now := arena.clock()) < arena.deadline:
            # by its own estimate it leads, but the judge could not play it yet
            waiting = next((one for one in self._contenders if one.arm.awaits_judge), None)
            if waiting is None:
                if leader.is_exhausted:
                    break
                self.give(leader, arena.deadline)
            elif waiting.arm.is_pending and not leader.is_exhausted:
                self.give(leader, min(arena.deadline, now + self._slice_seconds))
            else:
                self._first_slice(waiting, min(arena.deadline, now + _SHORTEST_SECONDS))

    @cached_property
    def _polisher(self) -> Arm:
        """Around the best policy: its plan, if that is what made it the best, or its weights."""
        return polishing_arm(self._arena, self._has_plan)
