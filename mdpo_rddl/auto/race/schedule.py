"""The race of the preset `auto`: who works when.

Where all states can be enumerated, the optimum is known before any of this begins; where they
can't, but the rules were grounded, a search by trials has gone ahead.

1. Constant actions on the exact model say in which units states and actions are of order 1.
2. The arms begin in the order of what they cost: `greedy`, where all actions have few values;
   `shooting`, where all are real and chance plays no part; the weights that all objects share; an
   open-loop plan, or each object's own weights; and the one that needs the model's gradient.
   The first two need not wait for the judge's program (`openings.py`).
3. Rounds: each slice of time goes to the arm that promises to gain most, by its latest pace, and
   one in eight to the one that has waited longest (`rounds.py`).
4. Another search around the best policy corrects the relaxation error.

A search for a plan that explores comes first where no constant and no random rule returns more than
the no-op, or a few of many only and chance plays no part.
"""

import logging
from collections.abc import Callable, Sequence

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import FIRST_SLICES, Arm
from mdpo_rddl.auto.arms.exploration import ExplorationArm
from mdpo_rddl.auto.arms.gradient import GRADIENT
from mdpo_rddl.auto.arms.own_weights import Around, OwnWeightsArm
from mdpo_rddl.auto.arms.plan_search import Evolving, PlanArm
from mdpo_rddl.auto.arms.policy_iteration import GREEDY
from mdpo_rddl.auto.arms.shared_weights import SHARED_WEIGHTS, SharedWeightsArm
from mdpo_rddl.auto.arms.shooting import SHOOTING
from mdpo_rddl.auto.arms.simple import RANDOM_RULE, SIMPLE, Rules, SimpleArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.outcome.unsearched import constant_without_rollouts, found_by_probing
from mdpo_rddl.auto.race.openings import LESS_GREEDY_SHARE, Openings
from mdpo_rddl.auto.race.polishing import polishing_arm
from mdpo_rddl.auto.race.rounds import gives_way, next_contender
from mdpo_rddl.auto.race.slices import SHORTEST_SECONDS
from mdpo_rddl.planner.config.search_section import Search as Shares

logger = logging.getLogger(__name__)

# random rules, of the time for the shared weights; more of them, of the time left
_RULES_SHARE, _MORE_RULES_SHARE = 0.25, 0.1
# of the rules: where fewer return more than the no-op, and no constant does, a reward is rare
_RARE_SHARE = 0.01
# of the time for a plan or own weights, for the plan, where chance plays a part
_PLAN_SHARE = 0.5
# of the time left, for the exploration: before the other arms, and for these if it finds nothing
_EXPLORATION_SHARE, _OTHERS_SHARE = 0.45, 0.4
# of the time left, at most, for an arm without compilation, by whether a constant finds a reward
_EARLY_SHARES, _LESS = {True: 0.3, False: 0.5}, 0.5


class Schedule(Openings):
    """Which arm works when.

    Attributes:
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
        """Does nothing yet; the other arguments are those of `Openings`.

        Args:
          initial: policies to begin with, whoever found them.
        """
        super().__init__(arena, shares, on_stage)
        self._initial = initial
        self._polishers: dict[bool, Arm] = {}
        # whether its plan is what has made the best feedback policy the best
        self._has_plan = False
        self.early: Arm | None = None
        self.random_return: float | None = None

    def run(self) -> None:
        """Gives arms their slices until the time is over."""
        arena, judge = self._arena, self._judge
        if not self._affording.search():
            self._end_with_constant()
            return
        simple = SimpleArm(arena)
        begins_at_once = not self._initial and self._knows_by_probing()
        by_probing = not (begins_at_once or self._initial) and self._has_probing_only()
        if not (begins_at_once or by_probing):
            self._judge_simple(simple)
        for candidate in self._initial:
            judge.record(candidate)
        self._judge_plans()
        if self.early is not None:
            until = arena.until(_EARLY_SHARES[self._finds_reward()])
            makes_late = begins_at_once and self._makes_greedy_late(until)
            self._try_early(self.early, arena.clock() if makes_late else until)
        if begins_at_once:
            if self._open_alone():
                self._finish()
                return
            self._judge_simple(simple)
        early = None if self.early is None or self.early.is_exhausted else self.early
        affords = self._affording.policies if early is None else self._affording.population
        if by_probing or not affords():
            self._end_without_population(early)
            return
        self._search(simple)

    def _end_without_population(self, early: Arm | None) -> None:
        """The rest of the time for rules by the probing's program, and for one that can go on."""
        logger.warning("there is too little time to search: compilation takes so long")
        if early is not None and (early.name == self._best.arm or not self._finds_reward()):
            self._end_with(early)
        for candidate in found_by_probing(self._arena):
            self._judge.record(candidate)
        if early is not None:  # what is left where no rules can be played
            self._end_with(early)

    def _search(self, simple: SimpleArm) -> None:
        """Everything that needs a population of rollouts."""
        arena = self._arena
        # before the population, whose program takes longer
        if self._learn_first():
            self._finish()
            return
        self._climb_first()
        self._on_stage("searching")
        shared = SharedWeightsArm(arena, RANDOM_RULE)
        if self._best.arm == SHOOTING:
            self._improve(shared)
            return
        self._play_rules(simple)
        is_rare = self._is_reward_rare(simple)
        if is_rare:
            simple.rules = Rules.MANY
            self.give(simple, arena.until(_MORE_RULES_SHARE))
        # a rule that comes upon a rare reward is far from the best plan, where there is one
        explores = is_rare and arena.has_plan and arena.plans.deterministic
        if not explores and self._finds_reward():
            self._improve(shared)
        else:
            self._explore(shared)

    def _is_reward_rare(self, simple: SimpleArm) -> bool:
        """Whether none was found yet, or by a few of many random rules only."""
        if not self._finds_reward():
            return True
        by_rule, paid = self._best.label == RANDOM_RULE, simple.paid_share
        return by_rule and paid is not None and paid < _RARE_SHARE

    def _play_rules(self, simple: SimpleArm) -> None:
        """A few random rules, and what random actions return."""
        arena = self._arena
        simple.rules = Rules.FEW
        self.give(simple, arena.until(_RULES_SHARE * self._shares.shared_until))
        if arena.has_plan and self._affording.population():
            self.random_return = arena.random_return()

    def _end_with_constant(self) -> None:
        """Where a rollout takes too long for any search on the compiled model."""
        self._judge.record(constant_without_rollouts(self._arena))
        self._judge_plans()
        self._judge_given(self._initial)
        if self.early is not None:
            self._try_early(self.early, self._arena.deadline)

    def _try_early(self, arm: Arm, until: float) -> None:
        """Slices for one that may have worked already, while each finds a better policy."""
        self._enter(arm)
        is_better = self._judge_candidates(arm)
        # it has had the short ones
        contender = self._contend(arm, lambda: arm.reached, FIRST_SLICES if is_better else 0)
        self._on_stage("searching")
        if is_better:
            # its returns are told with errors; where no other finds a reward, what it knows decides
            own, judge = not self._finds_reward(), self._judge
            self._give_while(contender, until, lambda: arm.progress if own else judge.best_mean)

    def _was_searched(self, candidate: Candidate) -> bool:
        """Whether it is better than the no-op, and no random rule."""
        return self._arena.beats_noop(candidate) and candidate.arm != SIMPLE

    def _explore(self, shared: SharedWeightsArm) -> None:
        """Where neither a constant nor one of few random rules beats the no-op."""
        arena = self._arena
        exploration = ExplorationArm(arena)
        # less where a net has found something already
        share = _EXPLORATION_SHARE * (_LESS if self._was_searched(self._best) else 1.0)
        self._search_plans(exploration, arena.until(share))
        if not arena.beats_noop(arena.incumbent) or not arena.plans.deterministic:
            self.give(shared, arena.until(self._shares.shared_until))
            self._has_plan &= arena.incumbent.arm == exploration.name
        if not self._was_searched(arena.incumbent):
            self._contend(exploration, lambda: arena.incumbent.mean)
        found = arena.beats_noop(self._best)
        rounds_until = arena.until(self._shares.rounds_until if found else _OTHERS_SHARE)
        self._open_programs(rounds_until, opens_gradient=False)
        self._compete(rounds_until, polishing=found)
        self._has_plan |= arena.incumbent.arm == exploration.name
        if arena.beats_noop(self._best):
            self._finish()
        else:
            self._on_stage("polishing")
            self._end_with(exploration)

    def _improve(self, shared: SharedWeightsArm) -> None:
        """Where a constant or a random rule beats the no-op, and no rare reward is looked for."""
        self._climb()
        has_rival = self._entrants.has_rival(self._best)
        if not has_rival and not self._affording.population(self._others_share()):
            self._finish()
            return
        rounds_until = self._arena.until(self._shares.rounds_until)
        if has_rival:
            self._open_gradient(rounds_until)
            self._search_in_turn(shared)
        self._contend(shared, lambda: shared.reached)
        self._open_programs(rounds_until, self._entrants.has_rival(self._best))
        self._compete(rounds_until)
        self._finish()

    def _search_in_turn(self, shared: SharedWeightsArm) -> None:
        """What searches without a gradient, each once before the rounds."""
        arena = self._arena
        own_until = arena.until(self._shares.own_until)
        self.give(shared, arena.until(self._shares.shared_until))
        if arena.has_plan and self._affording.plans():
            # where chance plays a part, a plan that leads now may yet be worse than own weights
            share = 1.0 if arena.plans.deterministic else _PLAN_SHARE
            plan_until = arena.clock() + share * (own_until - arena.clock())
            self._search_plans(PlanArm("plan", arena, Evolving()), plan_until)
        if not (self._has_plan and arena.plans.deterministic):
            around = Around(begins_with=SHARED_WEIGHTS)
            compiling = arena.plans.compile_seconds if arena.has_plan else 0.0
            until = min(own_until + compiling, arena.deadline)
            self.give(OwnWeightsArm("own weights", arena, around), until)
            self._has_plan &= arena.incumbent.arm == "plan"

    def _search_plans(self, arm: Arm, until: float) -> None:
        """Whether its plan is the best feedback policy decides what is polished."""
        if self._arena.plans.is_compiled or self._affording.population():
            self.give(arm, until)
        self._has_plan = self._arena.incumbent.arm == arm.name

    def _open_programs(self, until: float, opens_gradient: bool) -> None:
        """Opens those arms that are in the race, must compile and can be afforded."""
        if self._arena.clock() >= until:
            return  # there are no slices for them
        patience = self._affording.patience(until)
        taken = {arm.name for arm in self.arms}
        is_guided = self._best.planner is self._arena.planner and self._arena.beats_noop(self._best)
        if GREEDY not in taken and is_guided:
            self._learn_value(LESS_GREEDY_SHARE)
        arm = self._entrants.gradient(until, self.arms) if opens_gradient else None
        if arm is not None:
            self._open(arm, until, patience)

    def _compete(self, until: float, polishing: bool = True) -> None:
        """Rounds of slices, each for the arm that promises most.

        Args:
          until: when they end.
          polishing: whether there is a policy that is worth a search around it.
        """
        arena, judge = self._arena, self._judge
        if polishing:
            self._contend(self._polisher, lambda: arena.incumbent.mean)
        self._on_stage("racing")
        number = 0
        while (left := until - arena.clock()) > SHORTEST_SECONDS:
            pending = [one.arm for one in self._contenders if one.arm.is_pending]
            chosen = next_contender(self._contenders, number, judge.best_mean, left)
            if chosen is None and not pending:
                break
            if chosen is None or gives_way(chosen, pending, judge.best_mean, left):
                pending[0].await_program(min(until, arena.clock() + SHORTEST_SECONDS))
                continue
            self._give_slice(chosen, until)
            number += 1

    def _finish(self) -> None:
        """The rest of the time is for whoever leads."""
        best = self._best
        self._on_stage("polishing")
        leader = next((arm for arm in self.arms if arm.name == best.arm), None)
        is_feedback = best.planner is self._arena.planner
        if is_feedback or leader is None:
            self._end_with(self._polisher)
        # it goes on where there is no time to compile what polishes its policy
        if leader is not None and (leader.name == GRADIENT or not is_feedback):
            self._end_with(leader)

    @property
    def _polisher(self) -> Arm:
        """Around the best policy: its plan, if that is what made it the best, or its weights."""
        has_plan = self._has_plan
        return self._polishers.setdefault(has_plan, polishing_arm(self._arena, has_plan))
