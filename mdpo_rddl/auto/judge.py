"""Which policy is the best, by rollouts on the exact model that are the same for all."""

import logging
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.planner.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner

logger = logging.getLogger(__name__)


class Choice:
    """The best policy so far.

    Attributes:
      best: its parameters; None before the first.
      best_mean, best_error: mean return and standard error.
      name: where it came from.
      means: of all that were added, by name.
    """

    def __init__(self, planner: MDPOPlanner, rollouts: int, seed: int) -> None:
        """Compiles nothing yet.

        Args:
          planner: whose policies are compared.
          rollouts: of each policy.
          seed: of the rollouts, which no search sees.
        """
        self._mean_and_error = MeanReturn(planner, rollouts, seed)
        self.best: Any = None
        self.best_mean, self.best_error = -np.inf, np.inf
        self.name = ""
        self.means: dict[str, float] = {}

    def add(self, name: str, params: Any) -> bool:
        """Plays a policy; whether it is better than all before it."""
        return self.take(name, params, *self._mean_and_error(params))

    def take(self, name: str, params: Any, mean: float, error: float) -> bool:
        """As `add`, for a policy whose return is known; what is not finite is worst."""
        mean, error = (mean, error) if np.isfinite(mean) else (-np.inf, 0.0)
        self.means[name] = mean
        logger.info("%s: %.6g", name, mean)
        if self.best is not None and not mean > self.best_mean:
            return False
        self.best, self.name = params, name
        self.best_mean, self.best_error = mean, error
        return True


class MeanReturn:
    """Mean return of one policy and its standard error, on the exact model."""

    def __init__(self, planner: MDPOPlanner, rollouts: int, seed: int) -> None:
        """Compiles nothing yet."""
        self._returns = compile_exact_returns(planner, rollouts)
        # a seed that training does not use
        self._key = jax.random.fold_in(jax.random.PRNGKey(seed), 1)

    def __call__(self, params: Any) -> tuple[float, float]:
        """Plays the policy with these parameters."""
        one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[jnp.newaxis], params)
        returns = np.asarray(self._returns(self._key, one), float)[0]
        return float(np.mean(returns)), float(np.std(returns) / np.sqrt(len(returns)))
