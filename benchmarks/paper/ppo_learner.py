"""rejax's PPO, with JaxPlan's policy net in place of its own."""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen
from jax import Array, random
from rejax import PPO
from rejax.networks import VNetwork

from benchmarks.paper.exact_steps import ExactSteps
from benchmarks.paper.gymnax_problem import GymnaxProblem


class GaussianActor:
    """A policy net with a learnt standard deviation per action, as rejax calls its actors.

    The parameters are `{"net": JaxPlan's, "log_std": [actions]}`. The noise goes onto the raw
    action, and rejax clips the sum to the box, as our planner does.
    """

    def __init__(self, raw_action: Any, net: Any, actions: tuple[int, ...]) -> None:
        self._means = jax.vmap(raw_action, in_axes=(None, 0))
        self._initial = {"net": net, "log_std": jnp.zeros(actions)}

    def init(self, *_: Any) -> dict[str, Any]:
        """Parameters with standard deviations of 1."""
        return self._initial

    def apply(self, params: Any, *arguments: Any, method: str) -> Any:
        """Calls one of the other methods; their names are rejax's."""
        return getattr(self, method)(params, *arguments)

    def action_log_prob(self, params: Any, observations: Array, key: Array) -> tuple[Array, Array]:
        """Actions [B, actions] drawn for states [B, size], and their log densities [B]."""
        means = self._means(params["net"], observations)
        actions = means + jnp.exp(params["log_std"]) * random.normal(key, means.shape)
        return actions, self._log_density(means, params["log_std"], actions)

    def log_prob_entropy(
        self, params: Any, observations: Array, actions: Array
    ) -> tuple[Array, Array]:
        """Log densities [B] of actions, and the entropies [B] of the laws they came from."""
        means = self._means(params["net"], observations)
        entropy = jnp.sum(params["log_std"] + 0.5 * jnp.log(2 * jnp.pi * jnp.e))
        densities = self._log_density(means, params["log_std"], actions)
        return densities, jnp.broadcast_to(entropy, densities.shape)

    @staticmethod
    def _log_density(means: Array, log_std: Array, actions: Array) -> Array:
        return jnp.sum(jax.scipy.stats.norm.logpdf(actions, means, jnp.exp(log_std)), axis=-1)


def make_learner(
    steps: ExactSteps, net: Any, units: tuple[int, ...], epochs: int, **settings: Any
) -> PPO:
    """PPO on one rollout at a time, all of it one batch; what is not said here is rejax's default.

    Args:
      steps: the exact model.
      net: any parameters of the policy net, for their shapes.
      units: of the critic's hidden layers.
      epochs: updates after each rollout.
      **settings: of rejax's, in place of its defaults or ours.
    """
    ours = {
        "num_envs": 1,
        "num_steps": steps.horizon,
        "num_minibatches": 1,
        "num_epochs": epochs,
        "gamma": steps.discount,
    }
    return PPO(
        env=GymnaxProblem(steps),
        env_params=None,
        eval_callback=None,
        actor=GaussianActor(steps.raw_action, net, steps.lower.shape),
        critic=VNetwork(units, linen.tanh),
        **{**ours, **settings},
    )


def first_state(learner: PPO, key: Array, net: Any) -> Any:
    """The learner's state before its first iteration, with these parameters of the policy net."""
    state = learner.init_state(key)
    params = {**state.actor_ts.params, "net": net}
    return state.replace(actor_ts=state.actor_ts.replace(params=params))
