"""rejax's PPO, with a given policy net and optimiser in place of its own."""

from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import linen, struct
from flax.training.train_state import TrainState
from jax import Array, random
from rejax import PPO
from rejax.algos.algorithm import register_init
from rejax.networks import VNetwork

from mdpo_rddl.experiments.paper.gymnax_problem import GymnaxProblem
from mdpo_rddl.jaxplan.exact_steps import ExactSteps


class GaussianActor:
    """A policy net with a learnt standard deviation per action, as rejax calls its actors.

    The parameters are `{"net": JaxPlan's, "log_std": [actions]}`. The noise goes onto the raw
    action, and rejax clips the sum to the box, as our planner does.
    """

    def __init__(self, raw_action: Any) -> None:
        self._means = jax.vmap(raw_action, in_axes=(None, 0))

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


class NetPPO(PPO):
    """PPO that starts from given parameters of the policy net.

    Attributes:
      net: these parameters.
      optimizer: of actor and critic.
    """

    net: Any = struct.field(pytree_node=True, default=None)
    optimizer: optax.GradientTransformation = struct.field(pytree_node=False, default=None)

    @register_init
    def initialize_network_params(self, rng: Array) -> dict[str, TrainState]:
        """Actor and critic before the first update; standard deviations start at 1."""
        space = self.env.observation_space(self.env_params)
        actor = {"net": self.net, "log_std": jnp.zeros(self.action_space.shape)}
        critic = self.critic.init(rng, jnp.empty((1, *space.shape)))
        return {
            f"{name}_ts": TrainState.create(apply_fn=(), params=params, tx=self.optimizer)
            for name, params in (("actor", actor), ("critic", critic))
        }


def make_learner(
    steps: ExactSteps, optimizer: optax.GradientTransformation, units: tuple[int, ...], epochs: int
) -> NetPPO:
    """PPO on one rollout at a time, all of it one batch; what is not said here is rejax's default.

    Args:
      steps: the exact model.
      optimizer: of actor and critic.
      units: of the critic's hidden layers.
      epochs: updates after each rollout.
    """
    return NetPPO(
        env=GymnaxProblem(steps),
        env_params=None,
        eval_callback=None,
        actor=GaussianActor(steps.raw_action),
        critic=VNetwork(units, linen.tanh),
        optimizer=optimizer,
        num_envs=1,
        num_steps=steps.horizon,
        num_minibatches=1,
        num_epochs=epochs,
        gamma=steps.discount,
        normalize_rewards=True,
    )
