"""The recipe of the preset `auto`: probe, search, follow the gradient, choose.

1. Constant actions on the exact model say in which units states and actions are of order 1.
2. The few weights that all objects share are searched for without a gradient on the exact
   return, which neither flat regions nor cliffs stop; then an open-loop plan, or each object's own
   weights if the plan is no match for the rule.
3. MDPO follows the relaxed model's gradient from there and from the best constant action, with
   several step sizes side by side, in phases, each from the best policy so far.
4. Another search around the best policy evens out what the relaxed model has wrong.
5. Meanwhile, in a second process, JaxPlan's default planners have their try.
6. Whatever earns most in fresh exact rollouts is the result.

Where no constant action and no random rule earns anything, 2 to 4 are a search for a plan that
explores.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.auto.arms.feedback_search import FeedbackSearch
from mdpo_rddl.auto.arms.gradient import Descent, descend
from mdpo_rddl.auto.arms.jaxplan import Alternative, Alternatives
from mdpo_rddl.auto.arms.plan_search import PlanSearch
from mdpo_rddl.auto.fitting import scaled, simplified, without_plan, without_scales
from mdpo_rddl.auto.judge import Choice
from mdpo_rddl.auto.probing import Probe, probe, with_bias
from mdpo_rddl.auto.sizes import plans_fit
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.machine.background import Work, run_until
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import SEARCH, Search, read_search
from mdpo_rddl.planner.missing import missing_package
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.training import Progress, TrainingResult
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

_ROLLOUTS, _FEW_ROLLOUTS = 128, 2
_PROBING_SEED = 0
_OWN_SIGMA, _POLISHING_SIGMA = 0.03, 0.01
# of the time for the shared weights: random rules
_WIDE_SHARE = 0.25
# a search of a large problem evaluates at least so many policies
_FEWEST_POLICIES = 60
# the gradient's program takes longer to compile than the search's, and an iteration longer than
# the rollouts of one population
_GRADIENT_COMPILATIONS, _GRADIENT_EVALUATIONS = 6.0, 100.0
# with less time JaxPlan's planners have hardly compiled
_ALTERNATIVES_SECONDS = 40.0
# of the time: the second process may be late
_LATE_SHARE = 0.05
# of the time after it: the last call of the gradient may be late
_OVERRUN = 0.3


@dataclass(frozen=True)
class AutoResult:
    """What the recipe found.

    Attributes:
      config: the configuration that the policy belongs to.
      planner: compiled for it.
      training: the policy and how it came about.
      diagnostics: what was chosen and why, as JSON can hold it.
    """

    config: PlannerConfig
    planner: MDPOPlanner
    training: TrainingResult
    diagnostics: dict[str, Any]


def plan_automatically(
    problem: Problem,
    config: PlannerConfig,
    *,
    seed: int,
    programs: Path | None = None,
    on_stage: Callable[[str], None] = lambda name: None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> AutoResult:
    """Finds a policy.

    Args:
      problem: the parsed problem.
      config: with a `FeedbackPlan` and a section `[Search]`; `[Optimize] train_seconds` is
        the time for everything, compilation included.
      seed: of everything that is drawn.
      programs: where traced programs are kept from one process to the next, if anywhere.
      on_stage: called with the name of each part as it begins.
      on_progress: called while the gradient part goes on.

    Raises:
      InputError: if JaxPlan refuses the problem or the configuration.
    """
    started = time.monotonic()
    seconds = config.budget().seconds
    budget = read_search(config.sections) or Search()
    config = config.without_section(SEARCH)
    deadline = started + seconds
    wanted = budget.alternatives and seconds >= _ALTERNATIVES_SECONDS
    with Alternatives(problem, seed, seconds, wanted) as alternatives, _one_line_errors(problem):
        on_stage("probing")
        # the same for all seeds, whose programs then are the same too
        bare = build_planner(problem, without_scales(config)).planner
        found = probe(bare, _PROBING_SEED, started + budget.shared_until * seconds)
        config = scaled(config, found)
        large = found.policy_seconds is not None
        if large:
            alternatives.stop()  # its memory is needed
            config = simplified(config)
        elif not plans_fit(bare):
            config = without_plan(config)
        planner = build_planner(problem, config, programs).planner
        recipe = _Recipe(planner, found, budget, deadline, seed, on_stage, on_progress)
        try:
            recipe.run()
            recipe.alternative = alternatives.best(deadline + _LATE_SHARE * seconds)
        except (KeyboardInterrupt, Cancelled):
            if recipe.choice.best is None:
                raise
            logger.warning("interrupted: the best policy so far is kept")
    return recipe.result(problem, config, time.monotonic() - started)


class _Recipe:
    """The parts after probing, and what they have found so far.

    Attributes:
      choice: the best policy so far.
      searched, descent: what the searches and the gradient did.
      last: parameters of the last policy that was found.
      alternative: the better one of JaxPlan's defaults, if there is one.
    """

    def __init__(
        self,
        planner: MDPOPlanner,
        found: Probe,
        budget: Search,
        deadline: float,
        seed: int,
        on_stage: Callable[[str], None],
        on_progress: Callable[[Progress], None],
    ) -> None:
        self._planner, self._found, self._budget = planner, found, budget
        self._deadline, self._seed = deadline, seed
        self._on_stage, self._on_progress = on_stage, on_progress
        self._large = found.policy_seconds is not None
        params = planner.feedback_plan.initializer(jax.random.PRNGKey(seed), {}, None)
        self._nothing, self._constant = params, with_bias(params, found.start)
        self.choice = Choice(planner, _FEW_ROLLOUTS if self._large else _ROLLOUTS, seed)
        self._plans = PlanSearch(planner, found, seed) if "plan" in params else None
        self.searched: FeedbackSearch | None = None
        self.descent = Descent()
        self.last = self._constant
        self.alternative: Alternative | None = None

    def run(self) -> None:
        """Searches, follows the gradient and searches again, as far as there is time."""
        choice, left = self.choice, self._deadline - time.monotonic()
        policy_seconds = self._found.policy_seconds
        if policy_seconds is not None and policy_seconds * _FEWEST_POLICIES > left:
            logger.warning("there is too little time to search: a rollout takes so long")
            choice.take("constant", self._constant, self._found.start_return, np.inf)
            return
        choice.add("nothing", self._nothing)
        choice.add("constant", self._constant)
        self._on_stage("searching")
        shared = self._budget.shared_until
        self.searched = FeedbackSearch(
            self._planner, self._nothing, self._seed, self._until(shared)
        )
        choice.add("random rule", self.searched.wide(self._until(_WIDE_SHARE * shared)))
        plans = self._plans
        if plans is not None and choice.best_mean <= plans.bar:
            self._explore(plans, self.searched)
        else:
            self._improve(self.searched)

    def _until(self, share: float) -> float:
        """The end of a share of the time that is left now."""
        now = time.monotonic()
        return now + share * (self._deadline - now)

    def _explore(self, plans: PlanSearch, searched: FeedbackSearch) -> None:
        """For problems in which neither a constant nor a random rule earns more than nothing.

        Where there is nothing to earn nearby there is no gradient to follow either.
        """
        choice, budget = self.choice, self._budget
        until = self._until(budget.own_until)
        plan = plans.search(self._nothing, until=until, exploring=True)
        has_plan = choice.add("plan", plan)
        if choice.best_mean <= plans.bar or not self._found.deterministic:
            rule = searched.shared(self._until(budget.shared_until))
            has_plan &= not choice.add("shared weights", rule)
        self._on_stage("polishing")
        if choice.best_mean <= plans.bar:
            self.last = plans.search(plan, until=self._deadline, exploring=True)
        else:
            self.last = self._polish(searched, has_plan)
        choice.add("polished", self.last)

    def _improve(self, searched: FeedbackSearch) -> None:
        """For problems in which a constant or a random rule earns more than doing nothing."""
        choice, budget = self.choice, self._budget
        shares = budget.shared_until, budget.own_until, budget.gradient_until
        shared, own, gradient = (self._until(share) for share in shares)
        rule = searched.shared(shared)
        choice.add("shared weights", rule)
        has_plan = self._search_plan(own)
        if not has_plan:
            choice.add("own weights", searched.around(rule, _OWN_SIGMA, own))
        if self._has_time_for_the_gradient(searched, gradient):
            self._on_stage("compiling")
            self._follow_the_gradient(gradient)
        self._on_stage("polishing")
        self.last = self._polish(searched, has_plan, restarting=True)
        choice.add("polished", self.last)

    def _polish(self, searched: FeedbackSearch, has_plan: bool, restarting: bool = False) -> Params:
        """Around the best policy: its plan, if that is what made it the best, or its weights."""
        if self._plans is not None and has_plan:
            best = self.choice.best
            return self._plans.search(best, until=self._deadline, restarting=restarting)
        return searched.around(self.choice.best, _POLISHING_SIGMA, self._deadline)

    def _search_plan(self, until: float) -> bool:
        """Whether a plan is better than the best so far; given up early if it will not be."""
        if self._plans is None:
            return False
        plan = self._plans.search(
            self._nothing, until=until, rival=self.choice.best_mean, restarting=True
        )
        return self.choice.add("plan", plan)

    def _follow_the_gradient(self, until: float) -> None:
        starts = [self.choice.best, self._constant]

        def task(work: Work) -> None:
            descend(
                self._planner,
                self.descent,
                starts,
                self.choice,
                key=jax.random.PRNGKey(self._seed),
                deadline=until,
                work=work,
                on_progress=self._on_progress,
            )

        if not run_until(task, until + _OVERRUN * (self._deadline - until)):
            logger.warning("the gradient is given up: its program takes too long to compile")

    def _has_time_for_the_gradient(self, searched: FeedbackSearch, until: float) -> bool:
        needed = _GRADIENT_COMPILATIONS * searched.compile_seconds
        needed += _GRADIENT_EVALUATIONS * searched.evaluation_seconds
        left = until - time.monotonic()
        if self._large or needed > left:
            logger.warning("there is too little time for the gradient: %.0f s are left", left)
            return False
        return True

    def result(self, problem: Problem, config: PlannerConfig, seconds: float) -> AutoResult:
        """What was found, by the recipe or by the alternative."""
        choice, other = self.choice, self.alternative
        diagnostics = self._diagnostics()
        if other is not None:
            diagnostics["returns"][other.name] = other.mean
            margin = 2.0 * np.hypot(other.error, choice.best_error)
            if other.mean - choice.best_mean > margin:
                diagnostics["chosen"] = other.name
                planner = other.planner(problem)
                return AutoResult(other.config, planner, other.training, diagnostics)
        training = self.descent.result(choice.best, self.last, self._planner.horizon, seconds)
        return AutoResult(config, self._planner, training, diagnostics)

    def _diagnostics(self) -> dict[str, Any]:
        found, searched = self._found, self.searched
        returns = {"nothing": found.nothing, **self.choice.means}
        return {
            "chosen": self.choice.name,
            "returns": {n: mean if np.isfinite(mean) else None for n, mean in returns.items()},
            "units": found.units,
            "state_scales": {name: list(pair) for name, pair in found.state_scales.items()},
            "search_iterations": {
                "shared": searched.shared_iterations if searched else 0,
                "own": searched.own_iterations if searched else 0,
                "plan": self._plans.iterations if self._plans else 0,
            },
            "phases": self.descent.summary(),
        }


@contextlib.contextmanager
def _one_line_errors(problem: Problem) -> Iterator[None]:
    """What a problem makes JAX or JaxPlan raise, as an error of the input."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        cause = missing_package(error) or " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{problem.instance_path}: cannot be planned: {cause}") from error
