"""Arms that begin before others, and take most of the time where they find something."""

from collections.abc import Callable

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import difference_error
from mdpo_rddl.auto.arms.gradient import GRADIENT
from mdpo_rddl.auto.arms.policy_iteration import GREEDY
from mdpo_rddl.auto.arms.relaxed_plans import RelaxedPlansArm
from mdpo_rddl.auto.arms.shooting import SHOOTING
from mdpo_rddl.auto.arms.simple import SimpleArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.gains import return_to_beat
from mdpo_rddl.auto.outcome.unsearched import correct_by_probing, known_by_probing
from mdpo_rddl.auto.race.affording import Affording
from mdpo_rddl.auto.race.entrants import Entrants
from mdpo_rddl.auto.race.slices import SHORTEST_SECONDS, Slices, Terms
from mdpo_rddl.planner.config.search_section import Search as Shares

# of the time left, for a straight-line plan, while slices gain so much of the first's
_PLAN_SHARE, _LEAST_GAIN = 0.6, 0.0005
LESS_GREEDY_SHARE = 0.6
"""Of the time left, for greedy, where no reward was found yet, or after others."""
# where one was found, while slices gain; and in any case, for its first iterations tell little
_GREEDY_SHARE, _GREEDY_AT_LEAST = 0.85, 0.4
# the same where some action is a number or an object, or a state fluent a number: rules often do
# as well there
_NUMBERS_SHARE, _NUMBERS_AT_LEAST = 0.6, 0.2
# its compilation takes longer than expected now and then: so many times the delay must leave time
_MARGIN = 2.0
# of the time left, that others' programs may take where one of these leads: where greedy does, and
# where it does among numbers; where a plan does which gains no more, and where it still does
_GREEDY_LEADS_SHARE, _AMONG_NUMBERS_SHARE, _STALLED_SHARE, _RISING_SHARE = 0.3, 0.6, 0.5, 0.15
# times what the best of all others has gained over the no-op, that greedy has among numbers: then
# these are unlikely to come as far; and errors by which it must lead
_FAR, _LEAD_ERRORS = 2.0, 2.0
# of the time left, at most, for relaxed plans that may lead, and where no constant beats the no-op
_PLANS_SHARE, _HOPE_SHARE = 0.2, 0.6
# of the time left, that the judge's program and a population's may take together; else rules are
# searched by the program of the probing, in all of it
_COMPILING_SHARE = 0.8


class Openings(Slices):
    """Gives the first slices to what learns a value, or climbs along a straight-line plan.

    Attributes:
      plans: an arm that needs no compilation, and has worked already.
    """

    def __init__(
        self,
        arena: Arena,
        shares: Shares,
        on_stage: Callable[[str], None],
    ) -> None:
        """Gives nothing yet.

        Args:
          arena: where the arms meet.
          shares: of the time, and which arms are left out.
          on_stage: called with the name of each part as it begins.
        """
        super().__init__(arena, on_stage, shares.without)
        self._shares, self._affording = shares, Affording(arena)
        self._entrants = Entrants(arena, self._affording, shares.without)
        self.plans: RelaxedPlansArm | None = None
        # with what probing has said of them
        self._probed: list[Candidate] = []
        # whether a straight-line plan has had its slices and gains no more
        self._has_stalled = False

    def _judge_plans(self) -> None:
        """What relaxed plans have found, after another slice if they may lead."""
        if (arm := self.plans) is None:
            return
        self._enter(arm)
        seems_to_lead = arm.leading >= self._judge.best_mean
        # a first rule may take all of this; it knows nothing of integers that actions change
        is_hope = arm.is_untried and not arm.misses_numbers
        if not arm.is_exhausted and (is_hope or seems_to_lead):
            pays = self._arena.beats_noop(self._best)
            self.give(arm, self._arena.until(_PLANS_SHARE if pays else _HOPE_SHARE))
        self._judge_candidates(arm)

    def _finds_reward(self) -> bool:
        """Whether there is a better policy than the no-op, or none is looked for."""
        return not self._arena.has_plan or self._arena.beats_noop(self._arena.incumbent)

    def _knows_by_probing(self) -> bool:
        """Whether these arms can begin with what probing has found, without the judge's program.

        That is so in a race that begins, where a constant returns more than the no-op: what their
        policies return is told by rollouts of their own.
        """
        arena, judge = self._arena, self._judge
        if judge.incumbent is not None:
            return False
        until = arena.until(self._shares.rounds_until)
        if not (
            self._entrants.may_be_greedy(self._greedy_share) or self._entrants.may_shoot(until)
        ):
            return False
        noop, constant = known_by_probing(arena)
        if not constant.known_mean > return_to_beat(noop.known_mean, 0.0):
            return False
        for candidate in (noop, constant):
            judge.record(candidate)
        self._probed = [judged.candidate for judged in judge.judged]
        return True

    def _has_probing_only(self) -> bool:
        """Whether what has played the probing's constants has to play everything.

        That is so in a race that begins, where the judge's program and that of a population leave
        too little time for a search.
        """
        arena, judge = self._arena, self._judge
        if judge.incumbent is not None or arena.probed is None:
            return False
        if arena.problem.raises:  # an error that is rare in play is seen in many rollouts only
            return False
        can_play_rules = arena.probed.has_time(arena.deadline, arena.clock)
        if not can_play_rules or self._affording.others(_COMPILING_SHARE):
            return False
        for candidate in known_by_probing(arena):
            judge.record(candidate)
        correct_by_probing(arena)
        return True

    def _judge_simple(self, simple: SimpleArm) -> None:
        """Judges the no-op and the best constant, whatever probing has said of them."""
        judge = self._judge
        self.give(simple, self._arena.clock())
        for candidate in self._probed:
            found = judge.latest(candidate.label)
            if found is not None and found.returns is not None:
                judge.correct(candidate, found.returns)

    def _makes_greedy_late(self, until: float) -> bool:
        """Whether there is time for what learns a value now, and not any more then."""
        share, may_be_greedy = self._greedy_share, self._entrants.may_be_greedy
        later = _MARGIN * (until - self._arena.clock())
        return may_be_greedy(share) and not may_be_greedy(share, later)

    def _open_alone(self) -> bool:
        """Their slices; whether one leads by far, or with too little time for others' programs."""
        self._learn_value(self._greedy_share)
        self._climb()
        leader, affording = self._best.arm, self._affording
        if leader == GREEDY:
            has_numbers = self._entrants.has_numbers
            share = _AMONG_NUMBERS_SHARE if has_numbers else _GREEDY_LEADS_SHARE
            return self._is_greedy_far_ahead() or not affording.others(share)
        return leader == SHOOTING and not affording.others(self._others_share())

    def _is_greedy_far_ahead(self) -> bool:
        """Whether no other arm is likely to come as far as greedy has among numbers.

        Where all actions and states are bools it has most of the time in any case.
        """
        can_go_on = any(arm.name == GREEDY and not arm.is_exhausted for arm in self.arms)
        return can_go_on and self._leads_by_far()

    def _leads_by_far(self) -> bool:
        """Whether greedy leads by more than the best of all others has gained over the no-op."""
        best, arena = self._best, self._arena
        judged = (each.candidate for each in self._judge.judged)
        others = [each for each in judged if each.arm != GREEDY]
        if best.arm != GREEDY or not self._entrants.has_numbers or not others:
            return False
        other = max(others, key=lambda each: each.known_mean)
        if not arena.beats_noop(other):
            return False
        lead = best.known_mean - other.known_mean
        least = (_FAR - 1.0) * (other.known_mean - arena.noop_return.mean)
        return lead > max(least, _LEAD_ERRORS * difference_error(best, other))

    def _learn_first(self) -> bool:
        """Slices for what learns from exact rollouts, before all others but the judge's.

        Returns:
          Whether it leads by far.
        """
        if GREEDY in {arm.name for arm in self.arms}:
            return False
        if self._finds_reward():
            self._learn_value(self._greedy_share)
        else:
            self._learn_value(LESS_GREEDY_SHARE, is_rare=True)
        return self._is_greedy_far_ahead()

    def _climb_first(self) -> None:
        """Slices for straight-line plans, where a constant is better than the no-op."""
        if self._finds_reward():
            self._climb()

    def _climb(self) -> None:
        if SHOOTING in {arm.name for arm in self.arms}:
            return
        plan = self._entrants.straight_line(self._arena.until(self._shares.rounds_until))
        if plan is None:
            return
        until = self._arena.until(_PLAN_SHARE)
        self._begin_with(plan, Terms(until, lambda: _LEAST_GAIN))
        self._has_stalled = self._arena.clock() < until - SHORTEST_SECONDS

    def _open_gradient(self, until: float) -> None:
        """Opens the gradient before the searches in turn, if they would leave it too little time.

        Only where some action is a number or an object.

        Args:
          until: when the rounds end, by the clock.
        """
        arena, affording = self._arena, self._affording
        later = self._shares.own_until * (arena.deadline - arena.clock())
        later += affording.plans_seconds()
        if not self._entrants.decides_numbers or affording.gradient(GRADIENT, until, later=later):
            return
        if (arm := self._entrants.gradient(until, self.arms, warns=False)) is not None:
            self._open(arm, until, affording.early_patience(arm.usual_seconds, until))

    def _others_share(self) -> float:
        """Of the time left, that others' programs may take where a straight-line plan leads."""
        return _STALLED_SHARE if self._has_stalled else _RISING_SHARE

    @property
    def _greedy_share(self) -> float:
        return _NUMBERS_SHARE if self._entrants.has_numbers else _GREEDY_SHARE

    def _learn_value(self, share: float, is_rare: bool = False) -> None:
        """Slices for what learns a value.

        Args:
          share: of the time left, for all of them.
          is_rare: whether no reward was found yet; its policies must soon find some then.
        """
        until = self._arena.until(share)
        arm = self._entrants.greedy(until, share)
        if arm is None:
            return
        least = _NUMBERS_AT_LEAST if self._entrants.has_numbers else _GREEDY_AT_LEAST

        def at_least() -> float:
            return 0.0 if is_rare and not self._arena.beats_noop(self._best) else least

        self._begin_with(arm, Terms(until, at_least=at_least, by_policies=lambda: is_rare))
