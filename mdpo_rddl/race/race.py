"""From a problem to the best policy that the arms find within a budget."""

import contextlib
import dataclasses
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from mdpo_rddl.errors import Cancelled, note_heard
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.fitting import scaled, with_memory
from mdpo_rddl.planner.config.search_section import SEARCH, Search, read_search
from mdpo_rddl.problem.enumeration.model import require_actions, require_legal_start
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.race.arm import Arm, Candidate, Context
from mdpo_rddl.race.arms import portfolio
from mdpo_rddl.race.board import Board
from mdpo_rddl.race.budget import Budget, DeadlineError
from mdpo_rddl.race.evaluator import Evaluator
from mdpo_rddl.race.family import Family
from mdpo_rddl.race.outcome import Curve, Outcome, Point
from mdpo_rddl.race.probe import probe
from mdpo_rddl.race.scheduler import Schedule
from mdpo_rddl.simulator.simulator import Simulator

logger = logging.getLogger(__name__)

NOOP, CONSTANT, GIVEN = "no-op", "constant", "given policy"
SIMPLE = "constants"
"""The arm of the policies with which every race begins."""

# of the time: the result's own episodes
_CONFIRMING_SHARE = 0.03
# of the time, at most: the constants by which units and scales are found
_PROBING_SHARE = 0.1


def _ignore(*_: Any) -> None:
    pass


@dataclass(frozen=True)
class RaceOptions:
    """What a race is given beside the problem, the configuration, the budget and the seed.

    Attributes:
      on_stage: called with the name of each part as it begins.
      on_judged: called with each candidate once it was judged.
      on_iteration: called between two iterations of whichever arm works; what it raises ends the
        race, which keeps what it knows of a `Cancelled` or `KeyboardInterrupt`.
      initial: given the race's family of feedback policies, candidates to begin with.
      earlier: the candidates of the processes that this one goes on from.
      arms: that take part.
    """

    on_stage: Callable[[str], None] = _ignore
    on_judged: Callable[[Point], None] = _ignore
    on_iteration: Callable[[], None] = _ignore
    initial: Callable[[Family], Sequence[Candidate]] = lambda family: ()
    earlier: Curve = ()
    arms: Callable[[], Sequence[Arm]] = portfolio


def race(
    problem: Problem,
    config: PlannerConfig,
    budget: Budget,
    seed: int,
    options: RaceOptions | None = None,
) -> Outcome:
    """Finds a policy.

    Args:
      problem: the parsed problem.
      config: of feedback policies; units and scales that the problem shows are filled in.
      budget: how long everything may take.
      seed: of everything that is drawn.
      options: see `RaceOptions`.

    Raises:
      InputError: if there is no action, or none that is legal at the start, or the problem has
        something that the simulator does not know.
      KeyboardInterrupt, Cancelled: if interrupted before there was any policy.
    """
    require_actions(problem)
    require_legal_start(problem)
    options = RaceOptions() if options is None else options
    # the arrays are small: threads of a linear algebra library would wait for each other
    with threadpool_limits(1, user_api="blas"):
        return _race(problem, config, budget, seed, options)


def _race(
    problem: Problem, config: PlannerConfig, budget: Budget, seed: int, options: RaceOptions
) -> Outcome:
    simulator = Simulator(problem)
    options.on_stage("probing")
    seen = probe(problem, simulator, seed, budget.share(_PROBING_SHARE).check)
    if seen.raises:
        problem = dataclasses.replace(problem, raises=True)
    left_out = (read_search(config.sections) or Search()).without
    fitted = with_memory(scaled(config.without_section(SEARCH), seen), problem)
    confirming = _CONFIRMING_SHARE * budget.seconds
    searching = Budget(budget.began, budget.deadline - confirming, budget.clock)

    def on_iteration() -> None:
        searching.check()
        options.on_iteration()

    family = Family(problem, simulator, fitted, seed, on_iteration)
    context = Context(
        problem=problem,
        simulator=simulator,
        evaluator=Evaluator(simulator, seed),
        budget=searching,
        seed=seed,
        family=family,
        certain=seen.is_certain,
        on_iteration=on_iteration,
        race=subordinate,
    )
    board = Board(context, options.on_judged)
    noop = Candidate(SIMPLE, NOOP, family.policy(family.noop))
    constant = Candidate(SIMPLE, CONSTANT, family.policy(_constant(family, seen)))
    interrupted, chosen = False, None
    # what is solved or compiled beside the race begins first
    every = [arm for arm in options.arms() if arm.name not in left_out]
    with contextlib.closing(Schedule(context, every)) as schedule:
        try:
            with contextlib.suppress(DeadlineError):
                # the first one is judged whatever time there is
                for candidate in (*options.initial(family), noop, constant):
                    board.judge(candidate)
                options.on_stage("searching")
                schedule.run(board)
            options.on_stage("confirming")
            chosen = board.confirm(budget)
        except (KeyboardInterrupt, Cancelled) as stop:
            if board.leader is None:
                raise
            note_heard(stop)
            logger.warning("interrupted: the best policy so far is kept")
            interrupted = True
        arms = schedule.figures(board)
    assert board.leader is not None
    result = chosen or board.leader
    return Outcome(
        policy=result.candidate.policy,
        chosen=result.candidate,
        confirmed=np.zeros(0) if chosen is None else chosen.returns,
        points=tuple(board.points),
        arms=arms,
        units=seen.units,
        state_scales=seen.state_scales,
        lookup_scales=seen.lookup_scales,
        noop_return=next((each.mean for each in board.points if each.candidate is noop), None),
        random_return=None,
        seconds=budget.used,
        interrupted=interrupted,
        earlier=options.earlier,
    )


def subordinate(
    problem: Problem,
    config: PlannerConfig,
    budget: Budget,
    seed: int,
    on_judged: Callable[[Point], None],
    on_iteration: Callable[[], None],
) -> Outcome:
    """A race for an arm of another one; its optimum comes with the states' values."""
    arms = partial(portfolio, keeps_values=True)
    options = RaceOptions(on_judged=on_judged, on_iteration=on_iteration, arms=arms)
    return race(problem, config, budget, seed, options)


def _constant(family: Family, seen: Any) -> dict[str, Any]:
    """Parameters of the constant of the largest return."""
    best = int(np.argmax(seen.means))
    own = dict(family.noop["own"])
    for name, bias in family.raw({n: v[..., best] for n, v in seen.constants.items()}).items():
        own[name] = {**own[name], "bias": bias}
    return {**family.noop, "own": own}
