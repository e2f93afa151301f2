"""Returns of a policy on the exact pyRDDLGym environment, never on the relaxed model."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.machine.html import html_table
from mdpo_rddl.problem.episode import Episode, EpisodesRecorder, Policy
from mdpo_rddl.problem.legality import Referee

LOST = -1e9
"""At least so little is an episode worth that nobody can play to its end: the environment raises an
error in it, or comes to a state in which no legal action is found. That is below any that ends.

It is finite, for policies to be told apart by how often that happens."""


def lost_worth(share: Any) -> Any:
    """What an episode is worth of which so large a share of the steps cannot be played."""
    return LOST * (1.0 + share)


# 97.5% quantiles: of the normal law, which Student's is with many degrees of freedom, and with one
_NORMAL_QUANTILE, _CAUCHY_QUANTILE, _MANY_DEGREES = 1.959963984540054, 12.7062047361747, 1e9

# what pyRDDLGym's agents tell of an evaluation; its deviation divides by n
_STATISTICS: Mapping[str, Callable[[np.ndarray], np.floating]] = {
    "mean": np.mean,
    "median": np.median,
    "min": np.min,
    "max": np.max,
    "std": np.std,
}


@dataclass(frozen=True, eq=False)
class Evaluation(Mapping[str, float]):
    """The returns of a policy.

    It is also the mapping that `evaluate` of pyRDDLGym's `BaseAgent` returns: `mean`, `median`,
    `min`, `max` and `std`, the last one as there (n), unlike the property `std` (n - 1).

    Attributes:
      returns: discounted return of each episode [episodes].
      lengths: number of steps of each episode [episodes]; below the horizon where a
        termination condition or a violated state invariant ended it.
      illegal_actions: steps, over all episodes, at which the policy's action broke a
        precondition or the limit on actions.
      fallback_actions: how many of them played a legal action instead: the nearest that keeps
        the linear preconditions, or else the no-op, or an action near that.
      unplayable: steps of each episode at which no legal action was found [episodes]; such a step
        pays no more than the legal ones before it, and nothing at best.
      unmet: preconditions that stood in the way there, as RDDL.
    """

    returns: np.ndarray
    lengths: np.ndarray
    illegal_actions: int
    fallback_actions: int
    unplayable: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    unmet: tuple[str, ...] = ()

    def __getitem__(self, key: str) -> float:
        return float(_STATISTICS[key](self.returns))

    def __iter__(self) -> Iterator[str]:
        return iter(_STATISTICS)

    def __len__(self) -> int:
        return len(_STATISTICS)

    def _repr_html_(self) -> str:
        rows = {"episodes": f"{len(self.returns):,}", "mean return": f"{self.mean:z,.2f}"}
        if self.ci95 is not None:
            low, high = self.ci95
            rows["95% interval"] = f"[{low:z,.2f}, {high:z,.2f}]"
        rows["standard deviation"] = f"{self.std:z,.2f}"
        rows |= {key: f"{self[key]:z,.2f}" for key in ("median", "min", "max")}
        if self.illegal_actions:
            counts = f"{self.illegal_actions:,}, of which {self.fallback_actions:,} fell back"
            rows["steps with an illegal action"] = counts
        return html_table("Returns on the exact environment", rows)

    @property
    def worth(self) -> np.ndarray:
        """By which policies are compared [episodes]: the returns, but of lost episodes."""
        if not np.any(self.unplayable):
            return self.returns
        share = self.unplayable / np.maximum(1, self.lengths)
        return np.where(self.unplayable > 0, lost_worth(share), self.returns)

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
        return mean_interval(self.returns)


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """The mean of some values [N] and its standard error, infinite for a single one."""
    count = len(values)
    error = float(np.std(values, ddof=1) / np.sqrt(count)) if count > 1 else float("inf")
    return float(np.mean(values)), error


def mean_interval(values: np.ndarray) -> tuple[float, float] | None:
    """Student's 95% interval of a mean; None for one value.

    Args:
      values: independent ones [n].
    """
    if len(values) < 2:
        return None
    mean, error = mean_and_error(values)
    return _student(mean, error, len(values) - 1)


def difference(one: np.ndarray, other: np.ndarray) -> tuple[float, float] | None:
    """Welch's 95% interval of the mean of one less that of another; None if one has one value.

    Args:
      one, other: independent values [n], [m].
    """
    if min(len(one), len(other)) < 2:
        return None
    parts = [np.var(each, ddof=1) / len(each) for each in (one, other)]
    squares = sum(part**2 / (len(each) - 1) for part, each in zip(parts, (one, other), strict=True))
    degrees = sum(parts) ** 2 / squares if squares else np.inf
    return _student(float(np.mean(one) - np.mean(other)), float(np.sqrt(sum(parts))), degrees)


def _student(middle: float, error: float, degrees: float) -> tuple[float, float]:
    half = student_quantile(degrees) * error
    return middle - half, middle + half


def student_quantile(degrees: float) -> float:
    """The 97.5% quantile of Student's law with so many degrees of freedom, at least 1.

    With t = sqrt(n) tan(x), P(0 < T < t) is the integral of cos(x)^(n - 1) from 0 to x, times
    Gamma((n + 1) / 2) / (sqrt(pi) Gamma(n / 2)). To import scipy would take longer.
    """
    if degrees > _MANY_DEGREES:
        return _NORMAL_QUANTILE
    log_factor = math.lgamma(0.5 * (degrees + 1.0)) - math.lgamma(0.5 * degrees)
    factor = math.exp(log_factor) / math.sqrt(math.pi)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    low, high = _NORMAL_QUANTILE, _CAUCHY_QUANTILE
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        angle = math.atan(middle / math.sqrt(degrees))
        values = np.cos(0.5 * angle * (nodes + 1.0)) ** (degrees - 1.0)
        if factor * 0.5 * angle * float(weights @ values) < 0.475:
            low = middle
        else:
            high = middle
    return high


def episode_seeds(seed: int | Sequence[int], episodes: int) -> list[int]:
    """One environment seed per episode; the first n do not depend on `episodes`.

    Args:
      seed: of the run, from which they are derived, or they themselves.
      episodes: number of episodes.

    Raises:
      ValueError: if fewer seeds than episodes are given.
    """
    if isinstance(seed, Sequence):
        if len(seed) < episodes:
            raise ValueError(f"{episodes} episodes need as many seeds, not {len(seed)}")
        return list(seed[:episodes])
    return [
        int(np.random.SeedSequence([seed, episode]).generate_state(1)[0])
        for episode in range(episodes)
    ]


def evaluate(
    env: RDDLEnv,
    policy: Policy,
    episodes: int,
    seed: int | Sequence[int],
    on_episode: Callable[[], object] = lambda: None,
    recorder: EpisodesRecorder | None = None,
) -> Evaluation:
    """Plays a policy on an exact environment.

    Args:
      env: an environment with the numpy backend and `vectorized=True`.
      policy: maps step and observation to an action, which a `Referee` rules on.
      episodes: number of episodes.
      seed: of the run; each episode gets its own, derived from it. Or one for each episode.
      on_episode: called after each episode; False from it ends the evaluation there.
      recorder: keeps what happens in the episodes, if anybody does.

    Raises:
      ValueError: if `env` is not vectorized.
    """
    played = []
    for episode, state in begun_episodes(env, policy, episodes, seed, recorder):
        episode.play(state)
        played.append(episode)
        if on_episode() is False:
            break
    return evaluation_of(played)


def begun_episodes(
    env: RDDLEnv,
    policy: Policy,
    episodes: int,
    seed: int | Sequence[int],
    recorder: EpisodesRecorder | None = None,
) -> Iterator[tuple[Episode, Mapping[str, Any]]]:
    """The episodes of an evaluation, each with its first observation, to be played in turn.

    The arguments are those of `evaluate`.

    Raises:
      ValueError: if `env` is not vectorized.
    """
    if not env.vectorized:
        raise ValueError("the environment must be made with vectorized=True")
    referee = Referee(env)
    for episode_seed in episode_seeds(seed, episodes):
        episode = Episode(env, policy, referee, None if recorder is None else recorder.begin())
        yield episode, env.reset(seed=episode_seed)[0]


def evaluation_of(played: Sequence[Episode]) -> Evaluation:
    """What has come of episodes that were played to their ends."""
    return Evaluation(
        returns=np.array([episode.total for episode in played]),
        lengths=np.array([episode.steps for episode in played]),
        illegal_actions=sum(episode.illegal for episode in played),
        fallback_actions=sum(episode.fallback for episode in played),
        unplayable=np.array([episode.illegal - episode.fallback for episode in played], int),
        unmet=tuple(dict.fromkeys(text for episode in played for text in episode.unmet)),
    )
