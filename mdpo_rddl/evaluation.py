"""Returns of a policy on the exact pyRDDLGym environment, never on the relaxed model."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.constraints import RDDLConstraints
from scipy import stats

Policy = Callable[[int, Mapping[str, Any]], Mapping[str, Any]]
"""(step, observation per fluent) -> action tensor per fluent."""


@dataclass(frozen=True)
class Evaluation:
    """What a policy earned.

    Attributes:
      returns: discounted return of each episode [episodes].
      lengths: number of steps of each episode [episodes]; below the horizon where a
        termination condition or a violated state invariant ended it.
      illegal_actions: steps, over all episodes, whose action broke a precondition.
    """

    returns: np.ndarray
    lengths: np.ndarray
    illegal_actions: int

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(np.mean(self.returns))

    @property
    def std(self) -> float:
        """Sample standard deviation of the returns (n - 1); 0 for one episode."""
        return float(np.std(self.returns, ddof=1)) if len(self.returns) > 1 else 0.0

    @property
    def ci95(self) -> tuple[float, float] | None:
        """Student's 95% interval of the mean return; None for one episode."""
        n = len(self.returns)
        if n < 2:
            return None
        half = float(stats.t.ppf(0.975, n - 1) * self.std / np.sqrt(n))
        return self.mean - half, self.mean + half


def episode_seeds(seed: int, episodes: int) -> list[int]:
    """One environment seed per episode; the first n do not depend on `episodes`."""
    return [
        int(np.random.SeedSequence([seed, episode]).generate_state(1)[0])
        for episode in range(episodes)
    ]


def evaluate(
    env: RDDLEnv,
    policy: Policy,
    episodes: int,
    seed: int,
    on_episode: Callable[[], None] = lambda: None,
) -> Evaluation:
    """Plays a policy on an exact environment.

    Args:
      env: an environment with the numpy backend and `vectorized=True`.
      policy: maps step and observation to an action; clipped to the action box in 64 bit,
        since a bound rounded to 32 bit can lie outside.
      episodes: number of episodes.
      seed: of the run; each episode gets its own, derived from it.
      on_episode: called after each episode.

    Raises:
      ValueError: if `env` is not vectorized.
    """
    if not env.vectorized:
        raise ValueError("the environment must be made with vectorized=True")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is no box, already said when `env` was made
        bounds = RDDLConstraints(env.sampler, vectorized=True).bounds
    reals = [name for name, kind in env.model.action_ranges.items() if kind == "real"]
    box = {name: bounds[name] for name in reals}
    returns, lengths, illegal = [], [], 0
    for episode_seed in episode_seeds(seed, episodes):
        total, length, broken = _play(env, policy, box, episode_seed)
        returns.append(total)
        lengths.append(length)
        illegal += broken
        on_episode()
    return Evaluation(np.array(returns), np.array(lengths), illegal)


def _play(
    env: RDDLEnv, policy: Policy, box: Mapping[str, tuple[np.ndarray, np.ndarray]], seed: int
) -> tuple[float, int, int]:
    state, _ = env.reset(seed=seed)
    total, discount, illegal = 0.0, 1.0, 0
    step, done = 0, env.done
    while not done:
        actions = dict(policy(step, state))
        for name, (lower, upper) in box.items():
            if name in actions:
                actions[name] = np.clip(np.asarray(actions[name], np.float64), lower, upper)
        prepared = env.sampler.prepare_actions_for_sim(actions)
        illegal += not env.sampler.check_action_preconditions(prepared, silent=True)
        state, reward, terminated, truncated, _ = env.step(actions)
        total += discount * float(reward)
        discount *= env.discount
        step += 1
        done = terminated or truncated
    return total, step, illegal
