"""Which programs there is time to compile, and how long their compilation is waited for."""

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import ROLLOUTS
from mdpo_rddl.auto.arms.compiling import LONGEST_WAIT
from mdpo_rddl.auto.arms.gradient import GRADIENT
from mdpo_rddl.auto.arms.policy_iteration import GREEDY
from mdpo_rddl.auto.arms.shooting import SHOOTING
from mdpo_rddl.auto.search.one_by_one import POLICIES
from mdpo_rddl.auto.search.population import PROGRAMS as POPULATION_PROGRAMS
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.planner.programs.quick import Jit, is_short, light_jit, quick_jit, quick_share

PATIENCE = 0.3
"""Share of the time left for which all compilations together are waited for."""
# the same for a gradient's that comes before the searches
_EARLY_PATIENCE = 0.8
# a search of a large problem evaluates at least so many policies
_FEWEST_POLICIES = 60
# with fewer policies than that, one by one, rules find more by what has played the constants
_FEW_ONE_BY_ONE = 300
# programs like the judge's: what a gradient's is expected to take to compile, a quick one in its
# share of that (`results/compile_times`); and evaluations of a population, in the time of the
# fewest iterations that help
_GRADIENT_PROGRAMS, _EVALUATIONS = 10.9, 100.0
_SHOOTING_PROGRAMS, _SHOOTING_EVALUATIONS = 2.3, 20.0
# of the time left, that the program of plans may take beside feedback policies that work, and where
# chance plays no part, or the state is not observed: there a plan may well be as good
_PLANS_SHARE, _GOOD_PLANS_SHARE = 0.15, 0.3
# of what learns a value: its program beside the judge's, which may come from the cache, at most so
# many of these, else so many seconds and so many of these; it is of the quick kind where less than
# so many times its seconds are left; an iteration takes about so many times as long as the judge's
# rollouts of a candidate, more where many changes are tried in turn, and so many seconds; the
# fewest that find anything
_VALUE_PROGRAMS, _LEAST_VALUE_SECONDS = 4.0, 8.0
_VALUE_FIXED_SECONDS, _LATER_VALUE_PROGRAMS, _QUICK_VALUE_PROGRAMS = 6.0, 1.5, 3.0
_VALUE_EVALUATIONS, _EVALUATIONS_IN_TURN = 4.0, 1.5
_FITTING_SECONDS, _VALUE_ITERATIONS = 0.03, 30
# of the time left: what an arm that must compile may need
_AFFORDED = {GRADIENT: 0.7, SHOOTING: 0.5}
# the same of one that nothing else is likely to come near, if so many seconds are left
_AFFORDED_FIRST, _FIRST_AT_LEAST = 0.8, 15.0


class Affording:
    """Asked before anything that must be compiled begins."""

    def __init__(self, arena: Arena) -> None:
        """Compiles nothing."""
        self._arena = arena

    def search(self) -> bool:
        """Whether there is time for the rollouts of the shortest search."""
        seconds = self._arena.probe.policy_seconds
        left = self._arena.deadline - self._arena.clock()
        return seconds is None or seconds * _FEWEST_POLICIES <= left

    def population(self, share: float = 1.0) -> bool:
        """Whether there is time for what plays many policies at once.

        Args:
          share: of the time left, that its compilation may take.
        """
        return self._is_ready_in_time(POPULATION_PROGRAMS / share)

    def policies(self) -> bool:
        """Whether there is time for many policies, if need be one by one.

        There is none if these are few, and the program of the probing can play many.
        """
        arena = self._arena
        each, left = arena.judge.rollout_seconds, arena.deadline - arena.clock()
        if self.population():
            return True
        probed, until = arena.probed, arena.deadline
        can_play_rules = probed is not None and probed.has_time(until, arena.clock)
        return (_FEW_ONE_BY_ONE if can_play_rules else POLICIES) * each < left

    def others(self, share: float) -> bool:
        """Whether there is time for the judge's program and a population's, of which there is none.

        Args:
          share: of the time left, that these may take.
        """
        return self._is_ready_in_time((1.0 + POPULATION_PROGRAMS) / share)

    def plans(self) -> bool:
        """Whether there is time for plans where feedback policies have found something."""
        plans, is_observed = self._arena.plans, not self._arena.planner.rddl.observ_fluents
        share = _PLANS_SHARE if is_observed and not plans.deterministic else _GOOD_PLANS_SHARE
        return plans.is_compiled or self.population(share)

    def plans_seconds(self) -> float:
        """What the program of plans is likely to take before these are searched; 0 if none does."""
        arena = self._arena
        is_compiled_then = arena.has_plan and not arena.plans.is_compiled and self.plans()
        return POPULATION_PROGRAMS * self._usual_seconds if is_compiled_then else 0.0

    def value(self, share: float, in_turn: int = 0, later: float = 0.0) -> bool:
        """Whether there is time for what learns a value, whose policies make many model steps.

        Args:
          share: of the time left, that its compilation and its first iterations may take.
          in_turn: changes that a decision tries one after the other.
          later: seconds from now, at which it would begin.
        """
        left = self._arena.deadline - self._arena.clock() - later
        evaluations = max(_VALUE_EVALUATIONS, _EVALUATIONS_IN_TURN * (1 + in_turn))
        iteration = evaluations * self.batch_seconds + _FITTING_SECONDS
        needed = self.usual_seconds(GREEDY) + _VALUE_ITERATIONS * iteration
        return not self._is_large and needed <= share * left

    def value_jit(self) -> Jit:
        """What compiles what learns a value: of the quick kind where little time is left."""
        return quick_jit if self._is_value_quick else light_jit

    def usual_seconds(self, name: str) -> float:
        """How long the program of an arm that must compile is likely to take."""
        if name == GREEDY:
            kind = quick_share() if self._is_value_quick else 1.0
            return kind * self._value_seconds
        if name == SHOOTING:
            # it comes before the population
            return _SHOOTING_PROGRAMS * self._usual_seconds
        kind = quick_share() if is_short(self._arena.seconds) else 1.0
        return kind * _GRADIENT_PROGRAMS * self._usual_seconds

    def gradient(
        self, name: str, until: float, comes_first: bool = False, later: float = 0.0
    ) -> bool:
        """Whether there is time for an arm with a gradient.

        Args:
          name: of the arm.
          until: how long it may work, by the clock.
          comes_first: whether nothing else is likely to come near what it finds.
          later: seconds from now, at which it would begin.
        """
        if self._is_large:
            return False
        if name == SHOOTING:
            seconds = _SHOOTING_EVALUATIONS * self.batch_seconds
        else:
            seconds = _EVALUATIONS * self._arena.population.seconds
        left = until - self._arena.clock() - later
        needed = self.usual_seconds(name) + seconds
        has_time = comes_first and left >= _FIRST_AT_LEAST
        share = _AFFORDED_FIRST if has_time else _AFFORDED[name]
        return needed <= share * left

    def patience(self, until: float) -> float:
        """Until when compilations are waited for: not at all where others can work meanwhile.

        Args:
          until: how long the arms may work, by the clock.
        """
        now = self._arena.clock()
        return now if usable_cores() > 1 else now + PATIENCE * (until - now)

    def early_patience(self, usual: float, until: float) -> float:
        """The same for a gradient that comes before the searches.

        Args:
          usual: seconds that it should take.
          until: how long the arms may work, by the clock.
        """
        now = self._arena.clock()
        longest = min(LONGEST_WAIT * usual, _EARLY_PATIENCE * (until - now))
        return now if usable_cores() > 1 else now + longest

    @property
    def _is_large(self) -> bool:
        return self._arena.probe.policy_seconds is not None

    def _is_ready_in_time(self, programs: float) -> bool:
        """Whether so many programs like the judge's are compiled before the race is over."""
        left = self._arena.deadline - self._arena.clock()
        return left > programs * self._usual_seconds

    @property
    def _is_value_quick(self) -> bool:
        left = self._arena.deadline - self._arena.clock()
        return left < _QUICK_VALUE_PROGRAMS * self._value_seconds

    @property
    def _value_seconds(self) -> float:
        """How long what learns a value is likely to take to compile, not of the quick kind."""
        usual = self._usual_seconds
        later = _VALUE_FIXED_SECONDS + _LATER_VALUE_PROGRAMS * usual
        return max(_LEAST_VALUE_SECONDS, min(_VALUE_PROGRAMS * usual, later))

    @property
    def _usual_seconds(self) -> float:
        """What the judge's program took to compile, or else what plays constants, about as much."""
        return self._arena.judge.usual_seconds or self._arena.probe.compile_seconds

    @property
    def batch_seconds(self) -> float:
        """What 128 of the judge's rollouts took, or as many of constants in probing."""
        judge = self._arena.judge
        known = judge.rollout_seconds * ROLLOUTS / judge.rollouts
        return known or self._arena.probe.batch_seconds
