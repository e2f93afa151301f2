"""Parameter-exploring policy gradients: noise on a policy's parameters, no gradient of the model.

Sehnke et al. (2010), "Parameter-exploring policy gradients", with symmetric samples, ranks in
place of returns, and Adam (Kingma and Ba, 2015, https://arxiv.org/abs/1412.6980).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.auto.common.state import State, count_of, generator_place, set_generator
from mdpo_rddl.auto.common.timing import Clock

Evaluate = Callable[[int, np.ndarray], np.ndarray]
"""(iteration, parameters [P, D]) -> mean returns [P]; those that are not finite lose."""

_BETAS = (0.9, 0.999)
_TINY = 1e-8


@dataclass(frozen=True)
class Exploring:
    """How parameters are explored.

    Attributes:
      sigma: deviation of each parameter.
      step: of Adam, in sigmas.
      pairs: of symmetric samples in an iteration.
      seed: of the samples.
    """

    sigma: float = 0.3
    step: float = 0.1
    pairs: int = 4
    seed: int = 0


class ParameterExploration:
    """A normal law of parameters whose mean moves to where returns are large; it can be resumed.

    Attributes:
      mean: of the law [D].
      best: the parameters of the best single sample of the latest run [D]; the mean before that.
      best_return: what that one returned, in the rollouts in which it was found: where chance
        plays a part, mostly more than it is worth.
      iterations: done so far.
      is_flat: whether no two samples of an iteration have differed in their returns yet.
    """

    def __init__(self, start: np.ndarray, exploring: Exploring, clock: Clock) -> None:
        """Evaluates nothing yet.

        Args:
          start: the first mean [D].
          exploring: how parameters are explored.
          clock: what `run` asks for the time.
        """
        self.mean = np.asarray(start, float)
        self._exploring, self._clock = exploring, clock
        self._random = np.random.default_rng([exploring.seed, 4])
        self._first, self._second = np.zeros_like(self.mean), np.zeros_like(self.mean)
        self._sigma, self._moves = exploring.sigma, 0
        self.best, self.best_return = self.mean, -np.inf
        self.iterations, self.is_flat = 0, True

    def state(self) -> State:
        """The law, the optimiser's moments and the generator's state."""
        values = {
            "sigma": self._sigma,
            "moves": self._moves,
            "best_return": self.best_return,
            "iterations": self.iterations,
            "is_flat": self.is_flat,
            "generator": generator_place(self._random),
        }
        moments = {"first": self._first, "second": self._second}
        return State({"mean": self.mean, "best": self.best, **moments}, values)

    def restore(self, state: State) -> None:
        """Goes on where another exploration of as many parameters was.

        Raises:
          LookupError, OverflowError, TypeError, ValueError: if the state does not fit; nothing
            but the generator has changed then.
        """
        values, shape = state.values, self.mean.shape
        names = ("mean", "best", "first", "second")
        mean, best, first, second = (state.array(name, shape).astype(float) for name in names)
        sigma, best_return = float(values["sigma"]), float(values["best_return"])
        moves, iterations = count_of(values["moves"]), count_of(values["iterations"])
        if not 0.0 < sigma < np.inf:
            raise ValueError(f"its sigma is {sigma}, and not between 0 and infinity")
        if (least := second.min()) < 0.0:
            raise ValueError(f"its second moments have {least:g}, and 0 is the least")
        if np.isnan(best_return):
            raise ValueError("its best return is no number")
        set_generator(self._random, values["generator"])
        self.mean, self.best, self._first, self._second = mean, best, first, second
        self._sigma, self._moves, self.best_return = sigma, moves, best_return
        self.iterations, self.is_flat = iterations, bool(values["is_flat"])

    def narrow(self, factor: float, around: np.ndarray) -> None:
        """Goes on around a vector with a smaller deviation.

        Args:
          factor: of the deviation.
          around: the new mean [D].
        """
        self.mean, self._sigma = around, factor * self._sigma
        self._first, self._second = np.zeros_like(self.mean), np.zeros_like(self.mean)
        self._moves = 0

    def run(self, evaluate: Evaluate, until: float) -> None:
        """Moves the mean until the time is over; at least once.

        Args:
          evaluate: see `Evaluate`; the samples of one iteration should see the same random
            numbers.
          until: when to end, by the clock.
        """
        self.best, self.best_return = self.mean, -np.inf
        self._iterate(evaluate)
        while self._clock() < until:
            self._iterate(evaluate)

    def _iterate(self, evaluate: Evaluate) -> None:
        noise = self._random.normal(size=(self._exploring.pairs, self.mean.size))
        samples = self.mean + self._sigma * np.concatenate([noise, -noise])
        returns = np.asarray(evaluate(self.iterations, samples), float)
        returns = np.where(np.isfinite(returns), returns, -np.inf)
        self.is_flat &= bool(np.all(returns == returns[0]))
        self.iterations += 1
        first = int(np.argmax(returns))
        if returns[first] > self.best_return:
            self.best, self.best_return = samples[first], float(returns[first])
        ranks = _ranks(returns)
        gains = ranks[: len(noise)] - ranks[len(noise) :]
        self._move(gains @ noise / len(noise))

    def _move(self, gradient: np.ndarray) -> None:
        """One step of Adam uphill, in units of sigma."""
        self._moves += 1
        one, two = _BETAS
        self._first = one * self._first + (1.0 - one) * gradient
        self._second = two * self._second + (1.0 - two) * gradient**2
        mean = self._first / (1.0 - one**self._moves)
        scale = np.sqrt(self._second / (1.0 - two**self._moves)) + _TINY
        self.mean = self.mean + self._exploring.step * self._sigma * mean / scale


def _ranks(returns: np.ndarray) -> np.ndarray:
    """From -0.5 for the smallest to 0.5; equal returns have equal ranks."""
    below = np.sum(returns[:, np.newaxis] > returns, axis=1)
    above = np.sum(returns[:, np.newaxis] < returns, axis=1)
    return (below - above) / (2.0 * max(1, len(returns) - 1))
