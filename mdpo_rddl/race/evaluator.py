"""What a policy returns: episodes on the simulator that are the same for all policies."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.evaluation import lost_worth
from mdpo_rddl.simulator.common import CommonNumbers
from mdpo_rddl.simulator.rollouts import Rollouts, rollout
from mdpo_rddl.simulator.simulator import Simulator, State, Step

Check = Callable[[], None]
"""Called now and then to raise what ends the work."""

FEWEST = 16
"""Episodes that are played first; then as many again as there are, each time."""
RACE, CONFIRMATION = 0, 1
"""Streams of episodes: those by which candidates are compared, and those that no candidate was
chosen by."""


class Evaluator:
    """Plays policies, all of them in the same episodes.

    An episode that cannot be played to its end, since the environment raises an error or no action
    is legal, is worth `lost_worth` of the share of its steps that is missing: less than any return,
    and the less, the earlier.
    """

    def __init__(self, simulator: Simulator, seed: int) -> None:
        """Plays nothing yet.

        Args:
          simulator: of the problem.
          seed: of the episodes.
        """
        self._simulator, self._seed = simulator, seed

    def more(
        self, policy: Any, returns: np.ndarray, check: Check, stream: int = RACE
    ) -> np.ndarray:
        """What a policy is known to return, and that of as many more episodes.

        Args:
          policy: decides for many episodes at once, a `Replicated`.
          returns: what this has given before [N]; empty at first.
          check: called at each step; what it raises passes through.
          stream: of episodes.

        Returns:
          The worth of episodes [max(FEWEST, 2 N)].
        """
        done = len(returns)
        seed = [self._seed, stream, done]
        new = worth(self._simulator, policy, done or FEWEST, seed, check)
        return np.concatenate([returns, new])


def worth(
    simulator: Simulator,
    policy: Any,
    episodes: int | State,
    seed: Any,
    check: Check,
    groups: int = 1,
) -> np.ndarray:
    """The worth of episodes [B]; see `Evaluator`.

    Args:
      simulator: of the problem.
      policy: a `Replicated`.
      episodes: how many; or a state [*shape, B].
      seed: of all draws, whatever `numpy.random.SeedSequence` takes.
      check: called at each step; what it raises passes through.
      groups: of episodes side by side that have the same random numbers; all of them are played at
        once then, and must not be more than `simulator.block`.
    """
    told = getattr(policy, "were_played", None)

    def play(step: int, observation: Mapping[str, np.ndarray]) -> Any:
        check()
        actions = policy(step, observation)
        if told is not None:
            told(actions)
        return actions

    found = episodes_of(simulator, play, episodes, seed, groups)
    return worth_of(found, simulator.problem.horizon)


def episodes_of(
    simulator: Simulator, play: Any, episodes: int | State, seed: Any, groups: int
) -> Rollouts:
    """Episodes, of which groups side by side have the same random numbers; see `worth`."""
    return rollout(simulator if groups == 1 else _InCommon(simulator, groups), play, episodes, seed)


def worth_of(found: Rollouts, horizon: int) -> np.ndarray:
    """The worth [B] of episodes of at most so many steps; see `Evaluator`."""
    # a policy proposes what is not legal only where nothing is
    missing = np.where(found.errors, 1.0 - found.lengths / horizon, found.illegal / horizon)
    returns = np.where(np.isfinite(found.returns), found.returns, -np.inf)
    return np.where(found.errors | (found.illegal > 0), lost_worth(missing), returns)


class _InCommon(Simulator):
    """Draws the same numbers for each of several groups of replicas."""

    def __init__(self, simulator: Simulator, groups: int) -> None:
        vars(self).update(vars(simulator))
        self._groups = groups

    def step(
        self, state: State, actions: Mapping[str, Any], generator: Any, chances: Any = None
    ) -> Step:
        count = next(iter(state.values())).shape[-1]
        episodes = np.tile(np.arange(count // self._groups), self._groups)
        return super().step(state, actions, CommonNumbers(generator, episodes), chances)
