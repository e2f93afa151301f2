"""Returns of a policy on the exact pyRDDLGym environment, never on the relaxed model."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.problem.episode import Episode, Policy
from mdpo_rddl.problem.legality import Referee


@dataclass(frozen=True)
class Evaluation:
    """The returns of a policy.

    Attributes:
      returns: discounted return of each episode [episodes].
      lengths: number of steps of each episode [episodes]; below the horizon where a
        termination condition or a violated state invariant ended it.
      illegal_actions: steps, over all episodes, at which the policy's action broke a
        precondition or the limit on actions.
      fallback_actions: how many of them played a legal action instead: the no-op, or, where
        that is illegal too, an action near it.
    """

    returns: np.ndarray
    lengths: np.ndarray
    illegal_actions: int
    fallback_actions: int

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
        from scipy import special  # takes long to import, and can be while training goes on

        half = float(special.stdtrit(n - 1, 0.975) * self.std / np.sqrt(n))
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
      policy: maps step and observation to an action, which a `Referee` rules on.
      episodes: number of episodes.
      seed: of the run; each episode gets its own, derived from it.
      on_episode: called after each episode.

    Raises:
      ValueError: if `env` is not vectorized.
    """
    if not env.vectorized:
        raise ValueError("the environment must be made with vectorized=True")
    referee = Referee(env)
    played = []
    for episode_seed in episode_seeds(seed, episodes):
        episode = Episode(env, policy, referee)
        episode.play(env.reset(seed=episode_seed)[0])
        played.append(episode)
        on_episode()
    return Evaluation(
        returns=np.array([episode.total for episode in played]),
        lengths=np.array([episode.steps for episode in played]),
        illegal_actions=sum(episode.illegal for episode in played),
        fallback_actions=sum(episode.fallback for episode in played),
    )
