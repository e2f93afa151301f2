"""A bound on what any plan returns in an episode whose random numbers are known.

The episode is the one that a policy has met. Its random numbers are kept, and the return of a
plan that meets the same ones is the objective of a mixed integer linear program. The solver's
bound holds for every plan, and so does that of the program without integers; a plan that attains
it is played on the exact environment, again with those random numbers.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.episode import Episode, Policy
from mdpo_rddl.problem.evaluation import episode_seeds
from mdpo_rddl.problem.hindsight.draws import Draws, DrawsSimulator, MissingDrawError, draws_of
from mdpo_rddl.problem.hindsight.one_step import OneStep, one_step
from mdpo_rddl.problem.hindsight.program import NotLinearError, Optimum
from mdpo_rddl.problem.hindsight.unrolled import Unrolled, unroll
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import Problem, make_environment

_CLOSE = 1e-6
# for the program with integers, after the one without
_LEAST_SECONDS, _TIMES_LONGER = 1.0, 2.0


@dataclass(frozen=True)
class EpisodeBound:
    """What was found of one episode.

    Attributes:
      policy: discounted return of the policy.
      plan: of the best plan that was found, at least the policy's.
      bound: no plan returns more, up to the solver's tolerance.
    """

    policy: float
    plan: float
    bound: float

    @property
    def is_attained(self) -> bool:
        """Whether the plan returns what no plan exceeds."""
        is_close = self.bound - self.plan <= _CLOSE * max(1.0, abs(self.bound))
        return bool(np.isfinite(self.bound) and is_close)


@dataclass(frozen=True)
class Bounds:
    """Bounds of the first episodes of an evaluation.

    Attributes:
      episodes: the first ones, as many as there was time for.
      reason: why there are no more; None if there are all.
    """

    episodes: tuple[EpisodeBound, ...]
    reason: str | None = None


def find_bounds(
    problem: Problem,
    policy: Policy,
    episodes: int,
    seed: int,
    seconds: float,
    clock: Callable[[], float] = time.monotonic,
) -> Bounds:
    """Bounds of the episodes of an evaluation.

    Args:
      problem: what is played.
      policy: whose episodes they are; it is played once more.
      episodes, seed: as of `mdpo_rddl.problem.evaluation.evaluate`.
      seconds: after which no further episode begins; the solver's time is part of them.
      clock: tells the seconds.
    """
    if problem.model.observ_fluents:
        return Bounds((), "the state is not observed")
    until = clock() + seconds
    env = make_environment(problem, backend=DrawsSimulator)
    found: list[EpisodeBound] = []
    try:
        step = one_step(draws_of(env), EnumerationLimits(seconds=seconds, clock=clock))
        for number, episode_seed in enumerate(episode_seeds(seed, episodes)):
            left = until - clock()
            if left <= 0.0:
                return Bounds(tuple(found), "the time is over")
            finder = _Finder(env, step, until, clock)
            found.append(finder.find(policy, episode_seed, left / (episodes - number)))
    except NotEnumerableError as error:
        return Bounds(tuple(found), f"a step cannot be grounded: {error}")
    except (NotLinearError, MissingDrawError) as error:
        return Bounds(tuple(found), str(error))
    return Bounds(tuple(found))


class _Finder:
    """Bounds the return of one episode."""

    def __init__(
        self, env: RDDLEnv, step: OneStep, until: float, clock: Callable[[], float]
    ) -> None:
        self._env, self._step, self._until, self._clock = env, step, until, clock

    def find(self, policy: Policy, seed: int, seconds: float) -> EpisodeBound:
        """Plays the policy, and looks for better plans.

        Raises:
          NotLinearError: if there is no bound.
        """
        began = self._clock()
        simulator = draws_of(self._env)
        simulator.replay(None)
        returned = self._play(policy, seed)
        draws = simulator.draws
        unrolled = unroll(self._step, self._env, draws, self._check)
        written = self._clock()
        # without it there is nothing to tell of the episode
        left = self._until - written
        found = unrolled.program.maximise(unrolled.objective, left, relaxed=True)
        result = self._with(returned, np.inf, unrolled, found, draws)
        solved = self._clock()
        if unrolled.program.is_mixed and not result.is_attained:
            # large programs are not solved with integers, whatever time there is
            took = solved - written
            left = min(seconds - (solved - began), max(_LEAST_SECONDS, _TIMES_LONGER * took))
            found = unrolled.program.maximise(unrolled.objective, left, relaxed=False)
            result = self._with(result.plan, result.bound, unrolled, found, draws)
        if not np.isfinite(result.bound):
            raise NotLinearError("the solver has found no bound in time")
        return EpisodeBound(returned, result.plan, result.bound)

    def _check(self) -> None:
        if self._clock() > self._until:
            raise NotLinearError("no time to write the linear program")

    def _with(
        self, best: float, bound: float, unrolled: Unrolled, found: Optimum, draws: Draws
    ) -> EpisodeBound:
        """The best plan and the best bound so far."""
        if found.bound is not None:
            bound = min(bound, found.bound)
        if found.values is not None:
            plan = unrolled.plan(self._env, found.values)
            draws_of(self._env).replay(draws)

            def planned(step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
                return plan[step]

            best = max(best, self._play(planned, 0))
        if best - bound > _CLOSE * max(1.0, abs(bound)):
            raise NotLinearError("a plan that returns more than the solver's bound")
        return EpisodeBound(best, best, max(bound, best))

    def _play(self, policy: Policy, seed: int) -> float:
        episode = Episode(self._env, policy, Referee(self._env))
        try:
            episode.play(self._env.reset(seed=seed)[0])
        except MissingDrawError:
            raise
        except Exception as error:  # of the environment's, in play or under a plan
            raise NotLinearError(f"an episode ends in an error: {one_line_cause(error)}") from error
        return episode.total
