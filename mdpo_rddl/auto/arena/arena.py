"""What all arms of a race have in common: the problem, the planner, the judge and the clock."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdpo_rddl.auto.arena.judge import Judge, difference_error
from mdpo_rddl.auto.arena.plain import StraightLine
from mdpo_rddl.auto.arena.probed import Probed
from mdpo_rddl.auto.common.candidate import NOOP, Candidate
from mdpo_rddl.auto.common.compilations import Compilations, TooLateError
from mdpo_rddl.auto.common.gains import NoopReturn, return_to_beat
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.probing.constants import with_bias
from mdpo_rddl.auto.probing.probing import Probe, boxes
from mdpo_rddl.auto.search.plan_population import PlanPopulation
from mdpo_rddl.auto.search.population import (
    PROGRAMS,
    PopulationReturns,
    Wanted,
    compile_population,
)
from mdpo_rddl.auto.search.random_play import mean_until, random_plans
from mdpo_rddl.auto.search.weights import Weights
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.training.training import Progress
from mdpo_rddl.problem.load import Problem

UNLIMITED = 10**6
# of the time left, at most, for what random actions return
_RANDOM = 0.01


def _ignore(progress: Progress) -> None:
    del progress


def _ignore_pulse() -> None:
    pass


@dataclass(frozen=True, eq=False)
class Arena:
    """Where arms meet: what they are given, and through the judge what others have found.

    Attributes:
      problem: the parsed problem.
      config: the configuration of the feedback policy, with the scales that probing found.
      planner: compiled for it.
      probe: what constant actions have shown.
      judge: plays candidates; its incumbent is the best policy so far.
      seed: of everything that is drawn.
      deadline: when the race ends, by the clock.
      clock: what everybody asks for the time.
      search_share: of the time left, for the first search for weights: its rollouts are made
        so few that it can do enough iterations.
      began: when the race began, by the clock.
      most_iterations: of one training with a gradient.
      on_progress: called while such a training goes on.
      pulse: to be called between two iterations of a slice, when the arm's state is whole.
      probed: what has played the probing's constants; None of a large problem, or where another
        process has.
    """

    problem: Problem
    config: PlannerConfig
    planner: MDPOPlanner
    probe: Probe
    judge: Judge
    seed: int
    deadline: float
    clock: Clock = time.monotonic
    search_share: float = 0.25
    began: float = 0.0
    most_iterations: int = UNLIMITED
    on_progress: Callable[[Progress], None] = _ignore
    pulse: Callable[[], None] = _ignore_pulse
    probed: Probed | None = None

    @property
    def seconds(self) -> float:
        """Of the race."""
        return self.deadline - self.began

    @property
    def plan(self) -> FeedbackPlan:
        """The feedback policy, as the planner has compiled it."""
        plan = self.planner.plan
        assert isinstance(plan, FeedbackPlan)
        return plan

    @cached_property
    def noop(self) -> Params:
        """Parameters of the policy that plays the no-op."""
        return self.plan.noop(self.seed)

    @cached_property
    def constant(self) -> Params:
        """Parameters of the best constant policy that probing found."""
        return with_bias(self.noop, self.probe.start)

    @property
    def has_plan(self) -> bool:
        """Whether the policy has an open-loop plan beside the rule."""
        return "plan" in self.noop

    @cached_property
    def population(self) -> PopulationReturns:
        """Feedback policies side by side on the exact model; compiled when first asked for."""
        judge = self.judge
        known = judge.one_rollout_seconds, self.probe.deterministic
        compiled = PROGRAMS * judge.usual_seconds, judge.rollouts
        wanted = Wanted(self.search_share, *known, *compiled)
        return compile_population(self.planner, self.seed, wanted, self.clock, self.deadline)

    def after_population_compiles(self, weights: Weights, until: float) -> float:
        """As `after_plans_compile`, where weights are adapted.

        Raises:
          TooLateError: if the program is likely to take longer than what is left.
        """
        started, population = self.clock(), self.population
        if not population.is_compiled(weights):
            if population.compile_seconds > self.deadline - started:
                raise TooLateError("there is no time to compile what plays such policies")
            population.compile(weights)
        return self._put_off(until, started)

    def compile_population(self) -> None:
        """Compiles `population`, for the arm that needs it first."""
        _ = self.population

    @cached_property
    def plans(self) -> PlanPopulation:
        """Open-loop plans side by side on the exact model; compiled when first played."""
        plans = PlanPopulation(self.planner, self.probe, self.seed, self.clock, self.deadline)
        plans.on_generation = self.pulse
        return plans

    def after_plans_compile(self, params: Params, until: float) -> float:
        """The end of a slice that has its time for evolving: the program serves later ones, too.

        Args:
          params: whose plan is evolved.
          until: when the slice would end, by the clock.
        """
        started = self.clock()
        self.plans.compile(params)
        return self._put_off(until, started)

    def _put_off(self, until: float, started: float) -> float:
        """The end of a slice that compiles something since then, the race's at the latest."""
        return min(until + self.clock() - started, max(until, self.deadline))

    @cached_property
    def straight_line(self) -> StraightLine:
        """JaxPlan's own straight-line plan."""
        # it does not see the states, which may be random where the return is not
        return StraightLine(self.problem, self.probe.deterministic)

    @cached_property
    def compilations(self) -> Compilations:
        """What is compiled while the arms work."""
        return Compilations()

    def tell(self, progress: Progress) -> None:
        """Passes on how a training gets on, as part of the race and with the best return of all."""
        self.pulse()
        fraction = (self.clock() - self.began) / self.seconds
        best = max(progress.best_return, self.judge.best_mean)
        self.on_progress(progress._replace(fraction=min(1.0, fraction), best_return=best))

    @property
    def compile_seconds(self) -> float:
        """Of the judge's rollouts and the plans' population, which no arm is charged for."""
        plans = self.plans.compile_seconds if self.has_plan else 0.0
        return self.judge.compile_seconds + plans

    def random_return(self) -> float:
        """Mean return of random actions by the judge's rollouts; for a policy that has a plan."""
        judge, until = self.judge, self.until(_RANDOM)

        def played(params: Params) -> np.ndarray:
            return judge.returns_of(self.candidate("", "random", params))

        plans = random_plans(self.noop, boxes(self.planner, self.probe.units), self.seed)
        return mean_until(map(played, plans), lambda: self.clock() >= until)

    @property
    def incumbent(self) -> Candidate:
        """The best candidate so far of the arena's planner; the no-op before the first."""
        best = self.judge.best_of(self.planner)
        return self.candidate("", NOOP, self.noop) if best is None else best

    @property
    def noop_return(self) -> NoopReturn:
        """Of the no-op, by the judge; what probing has seen if it was not judged."""
        noop = self.judge.latest(NOOP)
        if noop is None:
            return NoopReturn(self.probe.noop_return, 0.0)
        count = 1 if noop.returns is None else len(noop.returns)
        return NoopReturn(noop.known_mean, noop.error * math.sqrt(count))

    def beats_noop(self, candidate: Candidate) -> bool:
        """Whether a judged candidate returns more than the no-op, and not by chance."""
        noop = self.judge.latest(NOOP)
        error = candidate.error if noop is None else difference_error(candidate, noop)
        return candidate.known_mean > return_to_beat(self.noop_return.mean, error)

    def candidate(self, arm: str, label: str, params: Params) -> Candidate:
        """A candidate of the arena's planner."""
        return Candidate(arm, label, self.config, self.planner, params)

    def until(self, share: float) -> float:
        """The end of a share of the time that is left now."""
        now = self.clock()
        return now + share * (self.deadline - now)
