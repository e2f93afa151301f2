"""The exact model as an environment of gymnax, which rejax trains on."""

from typing import Any

import jax.numpy as jnp
from flax import struct
from gymnax.environments.environment import Environment, EnvState
from gymnax.environments.spaces import Box
from jax import Array

from benchmarks.paper.exact_steps import ExactSteps


@struct.dataclass
class FluentState(EnvState):
    """Steps done, and the fluents."""

    fluents: Any


class GymnaxProblem(Environment):
    """One problem from its initial state to its horizon; there is nothing to parametrise."""

    def __init__(self, steps: ExactSteps) -> None:
        self._steps = steps

    def step_env(
        self, key: Array, state: FluentState, action: Array, params: None
    ) -> tuple[Array, FluentState, Array, Array, dict[Any, Any]]:
        """One step; done at the horizon."""
        fluents, reward = self._steps.step(key, state.fluents, action)
        time = state.time + 1
        done = jnp.asarray(time >= self._steps.horizon)
        state = FluentState(time=time, fluents=fluents)
        return self._steps.observe(fluents), state, reward, done, {}

    def reset_env(self, key: Array, params: None) -> tuple[Array, FluentState]:
        """The initial state."""
        state = FluentState(time=jnp.zeros((), int), fluents=self._steps.start)
        return self._steps.observe(self._steps.start), state

    def action_space(self, params: None) -> Box:
        """The actions' box."""
        return Box(self._steps.lower, self._steps.upper, self._steps.lower.shape)

    def observation_space(self, params: None) -> Box:
        """Vectors without bounds."""
        return Box(-jnp.inf, jnp.inf, (self._steps.state_size,))
