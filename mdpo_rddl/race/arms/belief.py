"""The vote over a belief, where the state is observed in part only.

A race of its own finds a policy of the underlying MDP, whose state is seen, and
`mdpo_rddl.policy.belief` plays by it. That race goes on in the arm's slices: it is held between two
iterations in a thread that only works while this one waits for it.
"""

import math
import threading
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.belief import PARTICLES
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.underlying import underlying_mdp
from mdpo_rddl.race.arm import Arm, Candidate, Context, Judged, Turn
from mdpo_rddl.race.budget import Budget, DeadlineError

VOTE = "vote over a belief"

# of the configuration: what was fitted to what is observed
_FITTED = ("units", "state_scales", "lookups", "memory")


class _Race:
    """A race that works in slices.

    Attributes:
      leader: its best candidate so far, and what that returns.
      iterations, worked: so far, and the seconds that they have taken.
      has_ended: whether it has nothing left to do.
    """

    def __init__(self, context: Context, problem: Problem, config: PlannerConfig) -> None:
        """Does nothing yet; the seconds of the context's budget are those of its slices."""
        assert context.race is not None
        self._given = context.race, problem, config, context.seed
        self._seconds, self._clock = context.budget.left, context.budget.clock
        self.leader: Judged | None = None
        self.iterations, self.has_ended = 0, False
        self._goes, self._rests = threading.Semaphore(0), threading.Semaphore(0)
        self._until = self._began = self.worked = 0.0
        self._is_cancelled = False
        self._raised: BaseException | None = None
        # nothing but numpy, held at a semaphore: the end of Python need not wait for it
        self._thread = threading.Thread(target=self._run, name=VOTE, daemon=True)
        self._thread.start()

    def work(self, until: float) -> None:
        """Goes on until then, by the clock.

        Raises:
          Exception: whatever the race has raised.
        """
        self._until, self._began = until, self._clock()
        self._goes.release()
        self._rests.acquire()
        self.worked += self._clock() - self._began
        if self._raised is not None:
            raise self._raised

    def close(self) -> None:
        """Ends it."""
        self._is_cancelled = True
        if not self.has_ended:
            self.work(self._clock())

    def _run(self) -> None:
        self._goes.acquire()
        race, problem, config, seed = self._given
        try:
            if not self._is_cancelled:
                budget = Budget(0.0, self._seconds, self._own_clock)
                race(problem, config, budget, seed, self._judged, self._pause)
        except DeadlineError:
            pass  # before it has judged anything
        except Exception as error:  # raised where the race is waited for
            self._raised = error
        finally:
            self.has_ended = True
            self._rests.release()

    def _own_clock(self) -> float:
        # a race whose time is over ends in order
        if self._is_cancelled:
            return math.inf
        return self.worked + self._clock() - self._began

    def _judged(self, point: Any) -> None:
        if point.became_incumbent:
            self.leader = Judged(point.candidate, point.returns)

    def _pause(self) -> None:
        self.iterations += 1
        if self._clock() >= self._until:
            self._rests.release()
            self._goes.acquire()


class VoteState(NamedTuple):
    """See `mdpo_rddl.race.arm.State`.

    It claims what its race does: whoever sees the state returns at least as much.

    Attributes:
      race: for the underlying MDP.
      voted: its candidate that the latest vote is of.
      judging: seconds of the votes' episodes.
    """

    race: _Race
    voted: Candidate | None = None
    judging: float = 0.0
    found: tuple[Candidate, ...] = ()
    claim: float = -math.inf
    iterations: int = 0
    is_ready: bool = True
    is_exhausted: bool = False
    details: Mapping[str, Any] = {"particles": PARTICLES}


def belief_vote() -> Arm:
    """The arm; where the state is observed in part only."""

    def init(context: Context) -> VoteState | None:
        if not context.problem.model.observ_fluents:
            return None
        try:
            underlying = underlying_mdp(context.problem)
        except InputError:
            return None
        config = context.family.config
        kept = {n: v for n, v in config.policy_arguments.items() if n not in _FITTED}
        config = config.with_values("Planner", method_kwargs=kept)
        return VoteState(_Race(context, underlying, config))

    def step(context: Context, state: VoteState, turn: Turn) -> VoteState:
        context.on_iteration()
        own = state.race
        own.work(turn.until)
        state = state._replace(found=(), iterations=own.iterations, is_exhausted=own.has_ended)
        # votes take long: they are judged for as long as is worked, at most
        if own.leader is None or (state.judging > own.worked and not own.has_ended):
            return state
        leader = own.leader.candidate
        if leader is state.voted:
            return state
        began = context.budget.used
        policy = context.family.policy(context.family.noop).voting_with(leader.policy)
        returns = context.evaluator.more(policy.replicated(), np.zeros(0), context.on_iteration)
        judging = state.judging + context.budget.used - began
        state = state._replace(voted=leader, claim=own.leader.mean, judging=judging)
        # in the same episodes
        if np.mean(returns) <= np.mean(turn.leader.returns[: len(returns)]):
            return state
        label = f"{VOTE}, {leader.label} of the underlying MDP"
        parents = tuple(dict.fromkeys((*leader.parents, leader.arm)))
        candidate = Candidate(VOTE, label, policy, parents, leader.uses_noise, returns)
        return state._replace(found=(candidate,))

    return Arm(VOTE, init, step, lambda state: state.race.close())
