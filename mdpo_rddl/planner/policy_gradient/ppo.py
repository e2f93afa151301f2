"""Proximal policy optimisation on rollouts of the exact model, as one compiled function.

Schulman et al. (2017), https://arxiv.org/abs/1707.06347: the clipped objective, a few epochs of
minibatches, an entropy bonus. The model is exact, so that the horizon is never cut, and all
rollouts begin in the problem's initial state.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array, lax, random

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.policy_gradient.actor import Actor
from mdpo_rddl.planner.policy_gradient.advantages import (
    Decay,
    advantages,
    normalised,
    returns_from,
)
from mdpo_rddl.planner.policy_gradient.critic import Critic
from mdpo_rddl.planner.policy_gradient.playing import Rollouts, compile_drawn_rollouts
from mdpo_rddl.planner.programs.quick import Jit

# of the scale of returns: what an iteration changes; and the least, of how they differ from step
# to step and of their size
_NEWS, _LEAST_SPREAD, _LEAST_SIZE = 0.1, 1e-2, 1e-3
_TINY = 1e-6
# up to a third less to compile, and as fast: the loops are few and large
_COMPILER_OPTIONS = {"xla_backend_optimization_level": 1}
# log of a ratio of probabilities: beyond that its exponential, or a gradient of it, is no number
_LARGEST_LOG_RATIO = 20.0


@dataclass(frozen=True)
class Learning:
    """How it is learnt.

    Attributes:
      rollouts: of an iteration.
      epochs: passes over them.
      minibatches: of an epoch.
      trace: lambda of the generalised advantages.
      clip: largest change of a proposal's probability, as a share, that is paid for.
      norm: largest norm of a gradient.
      critic_step: Adam's step size for the critic.
    """

    rollouts: int = 64
    epochs: int = 3
    minibatches: int = 4
    trace: float = 0.9
    clip: float = 0.2
    norm: float = 1.0
    critic_step: float = 2e-3


class Learner(NamedTuple):
    """All that an iteration changes.

    Attributes:
      params: of the feedback policy.
      critic: the critic's weights, in units of `scale`.
      moments: of Adam, for both.
      scale: of the returns; 0 before the first iteration.
    """

    params: Params
    critic: dict[str, Array]
    moments: tuple[Any, Any]
    scale: Array


class Pace(NamedTuple):
    """How far an iteration goes.

    Attributes:
      step: Adam's step size for the policy.
      entropy: what a nat of entropy is worth, in units of the advantage.
    """

    step: float
    entropy: float


class Shown(NamedTuple):
    """What a stochastic policy has shown in the rollouts of an iteration.

    Attributes:
      mean_return: discounted.
      entropy: of its proposals, the mean over the steps, in nats.
      is_finite: whether all that was learnt from it is; else the learner is what it was.
    """

    mean_return: Array
    entropy: Array
    is_finite: Array


class _Batch(NamedTuple):
    """What minibatches are made of, each leaf [B, H, ...]."""

    states: dict[str, Array]
    inputs: Array
    chosen: Array
    log_probability: Array
    advantage: Array
    target: Array
    share: Array


class PolicyGradient:
    """Learns a stochastic feedback policy; its deterministic one has the same parameters.

    Attributes:
      iterate: of a learner, a random key and a pace, the next learner and what the policy before
        it has shown; compiled.
    """

    def __init__(
        self, planner: MDPOPlanner, learning: Learning | None = None, jit: Jit | None = None
    ) -> None:
        """Compiles nothing yet.

        Args:
          planner: compiled, with a `FeedbackPlan`, of a model that `can_be_drawn`.
          learning: how it is learnt.
          jit: compiles `iterate`; if None, with little optimisation by XLA's backend.
        """
        self._learning = learning = learning or Learning()
        self._actor, self._critic = Actor(planner), Critic(planner.feedback_plan.feedback)
        self._steps = jnp.arange(planner.horizon)
        self._decay = Decay(float(planner.rddl.discount), learning.trace)
        self._play = compile_drawn_rollouts(planner, self._actor, learning.rollouts)
        clipped = optax.clip_by_global_norm(learning.norm)
        # the step size is the pace's
        self._optimizers = (
            optax.chain(clipped, optax.scale_by_adam(eps=_TINY)),
            optax.adam(learning.critic_step),
        )
        self.iterate: Callable[[Learner, Array, Pace], tuple[Learner, Shown]] = (jit or _jit)(
            self._iterate
        )

    def begin(self, params: Params, key: Array) -> Learner:
        """A learner that knows nothing of the returns.

        Args:
          params: of the feedback policy; any open-loop plan stays as it is.
          key: of the critic's weights.
        """
        critic = self._critic.initial(key)
        policy, value = self._optimizers
        params = jax.tree.map(jnp.asarray, params)
        moments = policy.init(_learnt(params)), value.init(critic)
        return Learner(params, critic, moments, jnp.zeros_like(critic["times"][0]))

    def _iterate(self, learner: Learner, key: Array, pace: Pace) -> tuple[Learner, Shown]:
        playing, shuffling = random.split(key)
        before, played = learner, self._play(playing, learner.params)
        learner, batch, entropy = self._observed(learner, played)
        update = functools.partial(self._update, pace=pace)

        def epoch(learner: Learner, key: Array) -> tuple[Learner, None]:
            order = random.permutation(key, self._learning.rollouts)
            parts = order.reshape(self._learning.minibatches, -1)
            minibatches = jax.tree.map(lambda leaf: leaf[parts], batch)
            return lax.scan(update, learner, minibatches)

        learnt, _ = lax.scan(epoch, learner, random.split(shuffling, self._learning.epochs))
        is_finite = _is_finite(learnt)
        learner = jax.tree.map(lambda new, old: jnp.where(is_finite, new, old), learnt, before)
        discounts = self._decay.discount**self._steps
        mean_return = jnp.mean(jnp.sum(played.rewards * discounts, axis=1))
        return learner, Shown(mean_return, entropy, is_finite)

    def _observed(self, learner: Learner, played: Rollouts) -> tuple[Learner, _Batch, Array]:
        """The learner with the scale of what is learnt from, that, and the mean entropy."""
        critic, scale = self._scaled(learner, played)
        weights = self._weights(learner.params, played.states)
        chosen = _each(self._actor.law.draw)(played.noise, weights)
        inputs = jax.vmap(jax.vmap(self._critic.inputs), in_axes=(0, None))
        read = inputs(played.states, self._steps)
        values = self._values(critic, read)
        gained = advantages(played.rewards / scale, values, played.alive, self._decay)
        share = played.alive / jnp.mean(played.alive)
        batch = _Batch(
            states=played.states,
            inputs=read,
            chosen=chosen,
            log_probability=_each(self._actor.law.log_probability)(weights, chosen),
            advantage=normalised(gained, played.alive),
            target=gained + values,
            share=share,
        )
        entropy = jnp.mean(share * _each(self._actor.law.entropy)(weights))
        return learner._replace(critic=critic, scale=scale), batch, entropy

    def _scaled(self, learner: Learner, played: Rollouts) -> tuple[dict[str, Array], Array]:
        """The critic in units of what returns lately differ by at one step, and these units."""
        following = returns_from(played.rewards, self._decay.discount)
        means = jnp.mean(following, axis=0)
        least = jnp.maximum(
            _LEAST_SPREAD * jnp.std(following), _LEAST_SIZE * jnp.max(jnp.abs(following))
        )
        scale = jnp.maximum(jnp.std(following - means), least) + _TINY
        is_first = learner.scale == 0.0
        scale = jnp.where(is_first, scale, (1.0 - _NEWS) * learner.scale + _NEWS * scale)
        factor = jnp.where(is_first, 1.0, learner.scale / scale)
        critic = self._critic.rescaled(learner.critic, factor)
        times = jnp.where(is_first, means / scale, critic["times"])
        return {**critic, "times": times}, scale

    def _update(self, learner: Learner, batch: _Batch, pace: Pace) -> tuple[Learner, None]:
        learnt = _learnt(learner.params)

        def loss(learnt: Params, critic: Any) -> Array:
            params = {**learner.params, **learnt}
            return self._loss(params, critic, batch, pace.entropy)

        of_policy, of_critic = jax.grad(loss, argnums=(0, 1))(learnt, learner.critic)
        policy, value = self._optimizers
        moves, policy_moments = policy.update(of_policy, learner.moments[0])
        moved = jax.tree.map(lambda p, move: p - pace.step * move, learnt, moves)
        params = {**learner.params, **moved}
        moves, value_moments = value.update(of_critic, learner.moments[1])
        critic = optax.apply_updates(learner.critic, moves)
        moments = policy_moments, value_moments
        return Learner(params, critic, moments, learner.scale), None

    def _loss(self, params: Params, critic: Any, batch: _Batch, entropy_bonus: Any) -> Array:
        law, clip = self._actor.law, self._learning.clip
        weights = self._weights(params, batch.states)
        change = _each(law.log_probability)(weights, batch.chosen) - batch.log_probability
        ratio = jnp.exp(jnp.clip(change, -_LARGEST_LOG_RATIO, _LARGEST_LOG_RATIO))
        kept = jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
        gain = jnp.minimum(ratio * batch.advantage, kept * batch.advantage)
        gain = gain + entropy_bonus * _each(law.entropy)(weights)
        error = (self._values(critic, batch.inputs) - batch.target) ** 2
        return jnp.mean(batch.share * (error - gain))

    def _weights(self, params: Params, states: dict[str, Array]) -> Array:
        """Of the law at each step of each rollout [B, H, n]."""
        one = functools.partial(self._actor.weights, params)
        return jax.vmap(jax.vmap(one), in_axes=(0, None))(states, self._steps)

    def _values(self, critic: Any, inputs: Array) -> Array:
        one = functools.partial(self._critic.value, critic)
        return jax.vmap(jax.vmap(one), in_axes=(0, None))(inputs, self._steps)


def _jit(function: Callable[..., Any]) -> Callable[..., Any]:
    return jax.jit(function, compiler_options=_COMPILER_OPTIONS)


def _learnt(params: Params) -> Params:
    """All but an open-loop plan: a value for every step is learnt slowly, and disturbs the rule."""
    return {name: part for name, part in params.items() if name != "plan"}


def _is_finite(learner: Learner) -> Array:
    leaves = jax.tree.leaves(learner)
    return functools.reduce(jnp.logical_and, [jnp.all(jnp.isfinite(leaf)) for leaf in leaves])


def _each(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function at each step of each rollout."""
    return jax.vmap(jax.vmap(function))
