"""The random numbers of an episode: kept while it is played, and played again."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.simulator import RDDLSimulator

Draws = list[dict[int, np.ndarray]]
"""Per step what was drawn, by the number that pyRDDLGym gives the expression."""

CERTAIN = ("KronDelta", "DiracDelta")
"""Laws with one value."""


class MissingDrawError(Exception):
    """A random number is needed that the episode did not draw."""


class DrawsSimulator(RDDLSimulator):
    """pyRDDLGym's simulator, which keeps what it draws, or takes it from an earlier episode."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Takes what pyRDDLGym's takes; keeps nothing yet."""
        self.draws: Draws = []
        self._given: Draws | None = None
        super().__init__(*args, **kwargs)

    def replay(self, draws: Draws | None) -> None:
        """From the next episode on takes random numbers from there; draws its own if None."""
        self._given = draws

    def reset(self) -> Any:
        """Begins an episode, of which nothing is kept yet."""
        self.draws = []
        return super().reset()

    def step(self, actions: Mapping[str, Any]) -> Any:
        """One step, whose random numbers are kept."""
        self.draws.append({})
        return super().step(actions)

    def _sample_random(self, expr: Any, subs: Any) -> Any:
        if expr.etype[1] in CERTAIN:
            return super()._sample_random(expr, subs)
        step = len(self.draws) - 1
        if self._given is None:
            value = super()._sample_random(expr, subs)
        elif step < len(self._given) and expr.id in self._given[step]:
            value = self._given[step][expr.id]
        else:
            raise MissingDrawError(f"step {step} drew no {expr.etype[1]} there")
        self.draws[step][expr.id] = value
        return value


def draws_of(env: RDDLEnv) -> DrawsSimulator:
    """The simulator of an environment that was made with `DrawsSimulator`.

    Raises:
      TypeError: if it was made with another one.
    """
    if not isinstance(env.sampler, DrawsSimulator):
        raise TypeError(f"the simulator is a {type(env.sampler).__name__}")
    return env.sampler
