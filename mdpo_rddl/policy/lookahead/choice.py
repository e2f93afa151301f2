"""Whether to think at all, and how: short paired trials while the policy is prepared."""

import functools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.planner.exact.exact import fluent_bytes
from mdpo_rddl.policy.lookahead.base import ByPlans, Method, Prepared, Tabled
from mdpo_rddl.policy.lookahead.belief import Believer, believing, known_at, note_played
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.gradient_steps import GradientSteps
from mdpo_rddl.policy.lookahead.qmdp import try_qmdp
from mdpo_rddl.policy.lookahead.residuals import Residuals
from mdpo_rddl.policy.lookahead.sequences import Sequences
from mdpo_rddl.policy.lookahead.simulator import Simulator
from mdpo_rddl.policy.lookahead.table_base import TableBase
from mdpo_rddl.policy.lookahead.trials import (
    FEWEST_STATES,
    MOST_STATES,
    NO_TIME,
    State,
    Trial,
    Trials,
)
from mdpo_rddl.policy.paired_episodes import STREAM
from mdpo_rddl.problem.chance import has_draws, rewards_are_certain
from mdpo_rddl.problem.evaluation import episode_seeds
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import Problem, make_environment

_EPISODES = 4
# where compilation took longer than expected, so much of the time is there for trials all the same
_BEYOND = 0.1
OPTIMAL = "the optimum is proven"
PLANS = "the policy plans at each decision as it is"
RAISES = "the environment raises an error in play"
LARGE = "rollouts take too much memory"
# of one rollout's fluents, of which a call holds those of a hundred or more several times
_MOST_FLUENT_BYTES = 4 * 10**6
# the programs and the trials of all methods take at most so many seconds and decisions
_COMPILE_SECONDS, _DECISIONS = 20.0, 40
# of the time for planning; where the state is observed in part there is a filter to compile too,
# and episodes are played; where chance plays no part few scenarios tell all
_SHARE, _HIDDEN_SHARE, _CERTAIN_SHARE = 0.25, 0.4, 0.18
# what it may take to see that chance plays no part
_CERTAIN_SECONDS = 1.0
# of the time for the choice, the episodes that give the states may take
_VISITING_SHARE = 0.1
# what goes on with a policy of the underlying MDP may take; the rest is for the others, if need be
_QMDP_SHARE = 0.75
# so many candidates of a whole plan must fit into the memory that is meant for them
_WHOLE_PLANS = 256
# at so many states it is seen whether anything is random
_PLACES = 12
# the fractional parts of its multiples are spread evenly
_GOLDEN = 0.618033988749895


@dataclass(frozen=True, eq=False)
class Choice:
    """How to play.

    Attributes:
      policy: that thinks; None if the plain policy is to be played.
      trials: of each method that was tried.
      reason: why no method was tried; empty if some were.
      seconds: that the choice took, compilation included.
    """

    policy: LookaheadPolicy | None
    trials: Sequence[Trial]
    reason: str
    seconds: float

    @property
    def note(self) -> str:
        """Why the plain policy is played; empty if it is not."""
        if self.policy is not None:
            return ""
        short = all(trial.note == NO_TIME for trial in self.trials)
        return self.reason or (NO_TIME if short else "no gain")


@functools.lru_cache(maxsize=8)
def choice_share(problem: Problem) -> float:
    """Which share of the time for planning the choice has, as a rule.

    Where all actions are real two episodes of random actions are played, once.
    """
    model = problem.model
    if model.observ_fluents:
        return _HIDDEN_SHARE
    is_real = all(model.variable_ranges[name] == "real" for name in model.action_fluents)
    is_certain = is_real and rewards_are_certain(problem, _CERTAIN_SECONDS)
    return _CERTAIN_SHARE if is_certain else _SHARE


def longest_choice(seconds: float) -> float:
    """Seconds that the choice may take where nothing else limits it.

    Args:
      seconds: of a decision.
    """
    return _COMPILE_SECONDS + _DECISIONS * seconds


def choose(
    policy: Prepared | Tabled | ByPlans,
    seconds: float,
    within: float = math.inf,
    clock: Callable[[], float] = time.perf_counter,
    methods: Sequence[Method] | None = None,
) -> Choice:
    """Prepares the methods that apply and takes the one that gains most, if any does.

    Each makes decisions at states that the policy visits. The gain of a decision is measured again
    on scenarios that it did not see. Ties go to the plain policy. Where a table is played, and
    nothing gains in its states, the first method is for those that it does not know. If there is a
    policy of the underlying MDP, thinking with that is tried first, in episodes, and taken if it
    pays there: what single decisions gain is not what episodes gain.

    Args:
      policy: the prepared policy, or a table; for one that plans at each decision nothing is tried.
      seconds: of a decision.
      within: seconds for the choice. The first compilation tells how long others take; none is
        begun that would end later. A decision that has begun goes on to its end; where no time is
        left for trials they may go a tenth beyond.
      clock: tells the seconds.
      methods: that are tried where they apply; all there are if None.
    """
    if isinstance(policy, ByPlans):
        return Choice(None, [], PLANS, 0.0)
    started = clock()
    reason, trials = _unsuitable(policy), list[Trial]()
    chosen: LookaheadPolicy | None = None
    if not reason:
        try:
            base = TableBase(policy) if isinstance(policy, Tabled) else policy
        except (InputError, ValueError) as error:
            return Choice(None, [], one_line_cause(error), clock() - started)
        if clock() - started >= within:
            return Choice(None, [], NO_TIME, clock() - started)
        components = Components.of(base.planner)
        applying = [method for method in methods or _methods() if method.applies(components)]
        reason = "" if applying else "no method changes such actions"
        if applying:
            times = seconds, started + within
            try:
                with base.planner.computing():
                    chosen, trials = _tried(base, applying, times, clock)
            except RDDLValueOutOfRangeError:  # in an episode of the policy's
                reason = RAISES
    return Choice(chosen, trials, reason, clock() - started)


def thinking_agent(policy: Prepared | Tabled, seconds: float) -> LookaheadPolicy | None:
    """What thinks at each decision; None where that does not pay.

    The choice lasts up to `longest_choice(seconds)` seconds.

    Args:
      policy: the prepared policy, or a table.
      seconds: of a decision.

    Raises:
      InputError: if that is no time.
    """
    if not 0.0 < seconds < math.inf:
        raise InputError(f"decision_seconds must be a number above 0, got {seconds!r}")
    return choose(policy, seconds, longest_choice(seconds)).policy


def _tried(
    policy: Prepared,
    methods: Sequence[Method],
    times: tuple[float, float],
    clock: Callable[[], float],
) -> tuple[LookaheadPolicy | None, list[Trial]]:
    """The best of the methods, if any pays or a table knows not all, and the trials of all.

    Args:
      policy: the prepared policy.
      methods: that apply.
      times: seconds of a decision, and when the choice is to end.
      clock: tells the seconds.
    """
    seconds, until = times
    no_time = [Trial(method.name, None, None, NO_TIME) for method in methods]
    before = clock()
    policy = believing(policy, seconds, until, clock)
    # rollouts take longer to compile than the filter
    if isinstance(policy, Believer) and clock() + (clock() - before) > until:
        return None, no_time
    shown = list[Trial]()
    if isinstance(policy, Believer):
        ends = clock() + _QMDP_SHARE * (until - clock())
        found, shown = try_qmdp(policy, methods, (seconds, ends), clock)
        # in others' rollouts a policy goes on that is not played
        if found is not None or policy.vote is not None:
            return found, shown
    within, components = until - clock(), Components.of(policy.planner)
    visited = _visited(policy, _lasting(_VISITING_SHARE * within, clock))
    simulator = Simulator(policy, _depth(components, policy.problem, methods), clock)
    if not simulator.prepare(visited[0][1], seconds, until, visited[1:_PLACES]):
        return None, [*shown, *no_time]
    methods = [each for each in methods if each.is_for_chance or not simulator.is_random]
    if not methods:
        return None, shown
    if any(method.climbs for method in methods):
        simulator.prepare_climbing(visited[0][1], until)
    few = 2 * FEWEST_STATES * seconds * len(methods)
    until = max(until, clock() + min(few, _BEYOND * within))
    thinkers = [LookaheadPolicy(simulator, each, seconds, policy.seed, clock) for each in methods]
    trials = Trials(thinkers, simulator, seconds, clock).at(visited, until)
    best = _best(thinkers, trials)
    if best is None and isinstance(policy, TableBase) and simulator.may_draw:
        # what is unknown is too rare for trials, and the no-op a poor action there
        tried = [method for method, trial in zip(methods, trials, strict=True) if not trial.note]
        given = seconds, policy.seed, clock, policy.is_unknown
        best = LookaheadPolicy(simulator, tried[0], *given) if tried else None
    return best, [*shown, *trials]


def _depth(components: Components, problem: Problem, methods: Sequence[Method]) -> int:
    """Steps of a candidate: without draws whole plans are kept from episode to episode.

    Where candidates of so many steps take too much memory plans are no longer than a method's.
    """
    depth = max(method.depth for method in methods)
    is_small = components.most_candidates(problem.horizon) >= _WHOLE_PLANS
    is_whole = depth > 1 and is_small and not has_draws(problem.model)
    return max(depth, problem.horizon) if is_whole else depth


def _best(thinkers: Sequence[LookaheadPolicy], trials: Sequence[Trial]) -> LookaheadPolicy | None:
    """The one that gains most, if any gains."""
    gains = [trial.mean or 0.0 if trial.pays else 0.0 for trial in trials]
    best = int(np.argmax(gains))
    return thinkers[best] if gains[best] > 0.0 else None


def _methods() -> list[Method]:
    return [FirstActions(), Coordinate(), Sequences(), Residuals(), GradientSteps()]


def _unsuitable(policy: Prepared | Tabled) -> str:
    """Why rollouts from the state at hand cannot be made, or are of no use; empty if they can."""
    if policy.problem.raises:
        return RAISES  # scenarios do not know where it does
    if isinstance(policy, Tabled):
        return "" if policy.optimum is None else OPTIMAL
    if policy.planner.memory.initial and not policy.planner.rddl.observ_fluents:
        return "the policy remembers"
    if policy.planner.plan.history_dependent:
        return "the policy reads the history"
    if policy.planner.preprocessor is not None:
        return "the policy reads preprocessed states"
    if fluent_bytes(policy.planner) > _MOST_FLUENT_BYTES:
        return LARGE
    return "" if policy.vote is None else _unsuitable_vote(policy.underlying)


def _unsuitable_vote(underlying: Prepared | Tabled | ByPlans | None) -> str:
    """The same of who votes by what is played in the underlying MDP."""
    if isinstance(underlying, ByPlans):
        return PLANS
    return RAISES if underlying is not None and underlying.problem.error_cost else ""


def _lasting(seconds: float, clock: Callable[[], float]) -> Callable[[], bool]:
    """Whether so many seconds are not over yet, from the first time that somebody asks."""
    until: float | None = None

    def lasts() -> bool:
        nonlocal until
        until = clock() + seconds if until is None else until
        return clock() < until

    return lasts


def _visited(policy: Prepared, has_time: Callable[[], bool]) -> list[tuple[int, State]]:
    """Steps and states, or beliefs, of a few episodes, the first ones far apart.

    The first is a start. Not all are kept meanwhile: a belief has thousands of particles.

    Args:
      policy: plays.
      has_time: whether to play on; not asked before there are as many as trials need.
    """
    env = make_environment(policy.problem)
    referee = Referee(env)
    found: list[tuple[int, State]] = []
    count, stride = 0, 1
    for seed in episode_seeds(STREAM + policy.seed, _EPISODES):
        state, step, done = env.reset(seed=seed)[0], 0, env.done
        while not done and (len(found) < FEWEST_STATES or has_time()):
            known = known_at(policy, step, state, is_tried=True)
            if count % stride == 0:
                found.append((step, known))
            if len(found) > 2 * MOST_STATES:
                found, stride = found[::2], 2 * stride
            count += 1
            actions = referee.rule(policy(step, known)).actions
            note_played(policy, known, actions)
            state, _, terminated, truncated, _ = env.step(actions)
            step, done = step + 1, terminated or truncated
    if not found:
        return [(0, known_at(policy, 0, env.reset(seed=policy.seed)[0]))]
    places = np.linspace(0, len(found) - 1, min(MOST_STATES, len(found))).astype(int)
    order = np.argsort(np.arange(len(places)) * _GOLDEN % 1.0)
    return [found[place] for place in places[order]]
