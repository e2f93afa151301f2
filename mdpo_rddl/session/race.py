"""Find a policy by a race, from a request to what the report is made of."""

import dataclasses
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import Cancelled, InputError, note_heard
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import SEARCH, read_search
from mdpo_rddl.policy.formula import FeedbackFormula
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.plannerless import PlannerlessPolicy
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.transfer import transferred
from mdpo_rddl.problem.evaluation import Evaluation, mean_and_error
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.race.arm import Candidate
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.family import Family
from mdpo_rddl.race.outcome import Curve, Outcome, Point
from mdpo_rddl.session.requests import FindTerms, Incumbent, Reporter

logger = logging.getLogger(__name__)

NOOP = "no-op"

_LEAST_SECONDS = 1.0
# of the difference's standard error, and of the return; fewer episodes do not tell their error
_ERRORS, _SHARE, _FEWEST_EPISODES = 4.0, 0.01, 5


class Noise(NamedTuple):
    """The noise that a result was trained with.

    Attributes:
      records: the recorded iterations, `mdpo_rddl.planner.training.training.Record`.
      sigma: scale of the noise per recorded iteration and step [recorded, H].
    """

    records: Sequence[Any]
    sigma: np.ndarray


@dataclass(frozen=True)
class RaceResult:
    """What a session keeps of a race.

    Attributes:
      policy: the result.
      config: of its planner; of the race where it has none.
      seconds: that everything took.
      compile_seconds: of these, spent in compilation that others waited for.
      interrupted: whether the race was ended early.
      promised: mean and standard error of the return by the race's own episodes; None where they
        are not known.
      diagnostics: of all arms and candidates, as JSON can hold it.
      noise: with which the result was trained, if it was, and how is known.
    """

    policy: AnyPolicy
    config: PlannerConfig
    seconds: float
    compile_seconds: float
    interrupted: bool
    promised: tuple[float, float] | None
    diagnostics: Mapping[str, Any]
    noise: Noise | None = None

    @property
    def is_proven(self) -> bool:
        """Whether the policy is a proven optimum."""
        return isinstance(self.policy, PlannerlessPolicy) and self.policy.optimum is not None


class RaceHooks(NamedTuple):
    """What goes on beside a race.

    Attributes:
      initial: candidates of an earlier process.
      earlier: all candidates that it has judged.
      used: seconds that it took.
      on_judged: called with each candidate that was judged.
      on_iteration: called between two iterations of an arm with the seconds used; what it raises
        as `Cancelled` ends the race.
    """

    initial: Sequence[Candidate] = ()
    earlier: Curve = ()
    used: float = 0.0
    on_judged: Callable[[Point], object] = lambda point: None
    on_iteration: Callable[[float], object] = lambda used: None


def is_race(config: PlannerConfig) -> bool:
    """Whether a configuration is for the race; else it is for one training."""
    return read_search(config.sections) is not None


def find_by_race(
    terms: FindTerms, reporter: Reporter, hooks: RaceHooks | None = None
) -> RaceResult:
    """The race of the preset `auto`.

    Args:
      terms: what to plan.
      reporter: is told how it gets on; what it raises as `Cancelled` ends it.
      hooks: what goes on beside.

    Raises:
      InputError: if the problem or the configuration cannot be used.
    """
    from mdpo_rddl.race.race import RaceOptions, race  # with all arms, which others do not need

    hooks = RaceHooks() if hooks is None else hooks
    now, whole = time.monotonic(), terms.config.budget().seconds
    # what an earlier process has found is judged even if that has used all the time
    deadline = now + max(whole - hooks.used, min(_LEAST_SECONDS, whole))
    budget, given = Budget(now - hooks.used, deadline), start_from(terms.start_from, terms.problem)

    def on_judged(point: Point) -> None:
        if point.became_incumbent:
            reporter.incumbent(Incumbent(point.candidate.arm, point.mean))
        hooks.on_judged(point)

    def on_iteration() -> None:
        reporter.racing(min(1.0, budget.used / whole))
        hooks.on_iteration(budget.used)

    def initial(family: Family) -> list[Candidate]:
        again = [each for one in hooks.initial for each in carried(one, family, terms.problem)]
        return [*again, *given(family)]

    options = RaceOptions(
        on_stage=reporter.stage,
        on_judged=on_judged,
        on_iteration=on_iteration,
        initial=initial,
        earlier=hooks.earlier,
    )
    try:
        outcome = race(terms.problem, terms.config, budget, terms.seed, options)
    except (KeyboardInterrupt, Cancelled) as stop:
        note_heard(stop)
        logger.warning("interrupted before anything was found: the no-op is kept")
        return _noop(terms, budget.used)
    return _result(outcome, terms)


def _noop(terms: FindTerms, seconds: float) -> RaceResult:
    """The result of a race that was ended before it has judged anything."""
    problem, config = terms.problem, terms.config.without_section(SEARCH).without_noise()
    formula = FeedbackFormula(problem, config)
    params = formula.actions.feedback.initial(np.random.default_rng(terms.seed))
    nothing: dict[str, Any] = {
        "parents": [],
        "noop_return": None,
        "random_return": None,
        "late_gain": None,
    }
    return RaceResult(
        policy=Policy(problem, config, params, {}, terms.seed, compiled=Compiled(formula=formula)),
        config=config,
        seconds=seconds,
        compile_seconds=0.0,
        interrupted=True,
        promised=None,
        diagnostics={"chosen": NOOP, "arm": NOOP, **nothing, "arms": {}, "candidates": []},
    )


def _result(outcome: Outcome, terms: FindTerms) -> RaceResult:
    policy = outcome.policy
    is_known = len(outcome.confirmed) >= _FEWEST_EPISODES
    candidates = tuple(outcome.curve)
    if isinstance(policy, Policy):
        policy = policy.with_candidates(candidates)
        if not outcome.chosen.uses_noise:
            policy = dataclasses.replace(policy, config=policy.config.without_noise())
    return RaceResult(
        policy=policy,
        config=policy.config if isinstance(policy, Policy) else terms.config,
        seconds=outcome.seconds,
        compile_seconds=0.0,
        interrupted=outcome.interrupted,
        promised=mean_and_error(outcome.confirmed) if is_known else None,
        diagnostics=outcome.diagnostics(),
    )


def less_than_promised(result: RaceResult, played: Evaluation) -> str:
    """What is said where the environment has paid clearly less than the race's own episodes.

    Both play by the same rules. Where one has a threshold, as a least production above which a
    plant counts as on, a policy may sit exactly on it, and rounding then decides.
    """
    if result.promised is None or len(played.returns) < 2:
        return ""
    promised, its_error = result.promised
    mean, error = mean_and_error(played.worth)
    if not mean < promised - _ERRORS * math.hypot(error, its_error) - _SHARE * abs(promised):
        return ""
    return (
        f"the exact environment paid {mean:,.6g} where the race's own episodes had "
        f"{promised:,.6g}: the policy may sit on a threshold, where rounding decides"
    )


def start_from(policy: AnyPolicy | None, problem: Problem) -> Callable[[Family], list[Candidate]]:
    """What makes candidates of the policy that a race is given, if any.

    Raises:
      InputError: if it is of another domain, or of another instance and no lifted rule.
    """
    if policy is None:
        return lambda family: []
    from mdpo_rddl.race.race import GIVEN

    given = Candidate(GIVEN, GIVEN, accepted(policy, problem))
    return lambda family: carried(given, family, problem)


def carried(candidate: Candidate, family: Family, problem: Problem) -> list[Candidate]:
    """A candidate as one of the race's own family, which its arms go on with, if it can be one."""
    policy, target = candidate.policy, family.policy(family.noop).formula
    if not isinstance(policy, Policy) or policy.votes or policy.formula is None:
        return [candidate]
    source, is_same = policy.formula.actions, _is_same(policy, problem)
    assert target is not None
    found = transferred(source, policy.params, target.actions, family.noop, is_same)
    ours = candidate._replace(policy=family.policy(found.params))
    if not found.left_out:
        return [ours]
    label, parts = policy.problem.label, ", ".join(found.left_out)
    logger.warning("of the policy of %s was left out: %s", label, parts)
    # the race's own policies play less than what was given
    return [ours, candidate] if is_same else [ours]


def accepted(policy: AnyPolicy, problem: Problem) -> Policy:
    """The policy, if a race can begin with it.

    Raises:
      InputError: if it is of another domain, or of another instance and no lifted rule.
    """
    ours, theirs = problem.domain_name, policy.problem.domain_name
    if ours != theirs:
        raise InputError(f"cannot start from a policy of the domain {theirs!r}: it is not {ours!r}")
    if isinstance(policy, RelaxedPlanPolicy):
        raise InputError("cannot start from relaxed plans: they are made anew at each decision")
    if not isinstance(policy, Policy):
        raise InputError("cannot start from a table: it holds actions for its own states only")
    if policy.formula is None and not _is_same(policy, problem):
        raise InputError(
            f"cannot start from a policy of {policy.problem.label} that is no lifted rule: "
            "it fits its own instance only"
        )
    return policy


def _is_same(policy: AnyPolicy, problem: Problem) -> bool:
    same_texts = policy.problem.digest == problem.digest
    return same_texts and policy.problem.horizon == problem.horizon
