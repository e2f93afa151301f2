"""Approximate policy iteration with a value that is learnt from exact rollouts, compiled.

Each iteration plays the greedy policy of the value (`GreedyPlan`), takes the lambda-returns of its
rollouts as what the value should be, and fits the value to those of the latest iterations: the
optimistic policy iteration of Bertsekas and Tsitsiklis (1996), "Neuro-Dynamic Programming".
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array, lax, random
from jax.flatten_util import ravel_pytree

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.plans.state_values import Weights
from mdpo_rddl.planner.policy_iteration.exploring import Explored, Trying, compile_exploring
from mdpo_rddl.planner.policy_iteration.targets import Decay, lambda_returns
from mdpo_rddl.planner.programs.quick import Jit, light_jit
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.start import initial_values
from mdpo_rddl.problem.evaluation import lost_worth

# of the scale of the targets: what an iteration changes
_NEWS = 0.2
_TINY = 1e-6


@dataclass(frozen=True)
class Learning:
    """How it is learnt.

    Attributes:
      rollouts: of an iteration; the first half of them is the greedy policy's.
      tried: share of the steps of the second half at which a change is decided at random.
      trace: lambda of the returns.
      kept: iterations whose rollouts are learnt from.
      updates: of the value, in an iteration.
      first_updates: times as many in the first one.
      minibatch: states of an update.
    """

    rollouts: int = 256
    tried: float = 0.1
    trace: float = 0.7
    kept: int = 4
    updates: int = 100
    first_updates: int = 4
    minibatch: int = 512


class Kept(NamedTuple):
    """What the value is fitted to, of the latest K iterations.

    Attributes:
      states: per state fluent [K, B, H, *shape].
      targets: less their mean at the step [K, B, H].
      counts: 1 where they count, else 0 [K, B, H].
    """

    states: dict[str, Array]
    targets: Array
    counts: Array


class Learner(NamedTuple):
    """All that an iteration changes.

    Attributes:
      weights: of the value, in units of `scale`, all in a row [W].
      moments: of Adam.
      times: mean target of each step [H].
      scale: of the targets.
      kept: of the latest iterations.
    """

    weights: Array
    moments: Any
    times: Array
    scale: Array
    kept: Kept


class Way(NamedTuple):
    """How an iteration goes.

    Attributes:
      step: Adam's step size; with 0 nothing is learnt or tried: all rollouts are the greedy
        policy's.
      is_first: whether it is the first iteration, in which half of the rollouts are the guide's
        and the others random.
    """

    step: Any
    is_first: Any = False


class Shown(NamedTuple):
    """What the policies have shown in the rollouts of an iteration.

    Attributes:
      returns: discounted [B]: the first half are the greedy policy's, or those of the guide; the
        others, too, where nothing is learnt.
      is_finite: whether all that was learnt is; else the learner is what it was.
    """

    returns: Array
    is_finite: Array

    @property
    def of_policy(self) -> Array:
        """The first half of the returns [B / 2]."""
        return self.returns[: len(self.returns) // 2]

    @property
    def mean_return(self) -> Array:
        """Of the first half of the returns."""
        return jnp.mean(self.of_policy)


class PolicyIteration:
    """Learns the value of the greedy policy.

    Attributes:
      rollouts: of an iteration.
    """

    def __init__(
        self,
        planner: MDPOPlanner,
        guide: FeedbackPlan,
        learning: Learning | None = None,
        jit: Jit = light_jit,
    ) -> None:
        """Compiles nothing yet but what puts weights in a row.

        Args:
          planner: compiled, with a `GreedyPlan`.
          guide: a compiled feedback policy of the same problem.
          learning: how it is learnt.
          jit: compiles an iteration.
        """
        assert isinstance(planner.plan, GreedyPlan)
        self._learning = learning = learning or Learning()
        self.rollouts = learning.rollouts
        self._planner, self._values = planner, planner.plan.values
        self._steps = jnp.arange(planner.horizon)
        self._discount = float(planner.rddl.discount)
        self._play = compile_exploring(planner, guide, learning.rollouts)
        # the step size is given to each iteration
        self._optimizer = optax.scale_by_adam()
        self._compiled: Callable[..., tuple[Learner, Shown]] = jit(self._iterated)
        # in a row, all weights are updated by the same few kernels, which take long to compile
        weights = self._values.initial(np.random.default_rng(0))
        self._of_row: Callable[[Array], Weights] = ravel_pytree(weights)[1]

    def begin(self, generator: np.random.Generator) -> Learner:
        """A learner that knows nothing; what is compiled for it takes no time to speak of.

        Args:
          generator: draws the value's weights.
        """
        weights, _ = ravel_pytree(self._values.initial(generator))
        real = weights.dtype
        size = self._learning.kept, self._learning.rollouts, self._planner.horizon
        start, _ = initial_values(self._planner).test
        names = self._planner.rddl.state_fluents
        states = {n: _zeros((*size, *start[n].shape[1:]), start[n].dtype) for n in names}
        kept = Kept(states, _zeros(size, real), _zeros(size, real))
        times, scale = _zeros((self._planner.horizon,), real), _zeros((), real)
        return Learner(weights, self._optimizer.init(weights), times, scale, kept)

    def policy(self, learner: Learner) -> Weights:
        """Parameters of the learner's greedy policy, in the units of the rewards."""
        weights = self._values.rescaled(self._of_row(learner.weights), learner.scale)
        return self._values.with_levels(weights, learner.times)

    def iterate(
        self, learner: Learner, key: Array, guiding: Any, way: Way
    ) -> tuple[Learner, Shown]:
        """The next learner, and what has been shown; the same one if what is learnt is not finite.

        Args:
          learner: what is known.
          key: of the rollouts and the updates.
          guiding: parameters of the guide.
          way: how the iteration goes.
        """
        learnt, shown = self._compiled(learner, key, guiding, way)
        return (learnt if bool(shown.is_finite) else learner), shown

    def _iterated(
        self, learner: Learner, key: Array, guiding: Any, way: Way
    ) -> tuple[Learner, Shown]:
        playing, deciding, fitting = random.split(key, 3)
        step, is_first = way
        learns = jnp.asarray(step) > 0.0
        half = jnp.arange(self._learning.rollouts) < self._learning.rollouts // 2
        tried = jnp.where(is_first, 1.0, self._learning.tried)
        trying = Trying(half & is_first, jnp.where(half | ~learns, 0.0, tried))
        played = self._play((playing, deciding), self.policy(learner), guiding, trying)
        seen = self._observed(learner, played, is_first)
        learner = self._fitted(seen, fitting, step, is_first)
        is_finite = _is_finite((learner.weights, learner.moments, learner.kept.targets))
        discounts = self._discount**self._steps
        returns = jnp.sum(played.rewards * discounts, axis=1)
        returns = jnp.where(played.lost > 0.0, lost_worth(played.lost), returns)
        return learner, Shown(returns, is_finite)

    def _observed(self, learner: Learner, played: Explored, is_first: Array) -> Learner:
        """The learner with these rollouts, what they return at each step, and the scale of that."""
        played = played._replace(states=_while_alive(played))
        values = self._each(learner.weights, played.states) * learner.scale + learner.times
        # at first there is no policy yet whose value other actions could disturb
        off_policy = played.is_tried & ~is_first
        trace: Any = jnp.where(is_first, 1.0, self._learning.trace)
        decay = Decay(self._discount, trace)
        returns = lambda_returns(played.rewards, values, played.alive, off_policy, decay)
        counts = played.alive * ~off_policy
        times = jnp.sum(returns * counts, axis=0) / (jnp.sum(counts, axis=0) + _TINY)
        targets = returns - times
        spread = jnp.sqrt(jnp.sum(counts * targets**2) / (jnp.sum(counts) + _TINY)) + _TINY
        scale = jnp.where(is_first, spread, (1.0 - _NEWS) * learner.scale + _NEWS * spread)
        new = Kept(played.states, targets, counts)
        kept = jax.tree.map(functools.partial(_pushed, is_first), learner.kept, new)
        return learner._replace(times=times, scale=scale, kept=kept)

    def _fitted(self, learner: Learner, key: Array, step: Any, is_first: Array) -> Learner:
        """The learner after so many updates of the value."""
        kept, learning = learner.kept, self._learning
        # ahead of the updates: in their midst each kernel would draw what it reads
        shape = learning.updates, 3, learning.minibatch
        drawn = with_fast_random_numbers(lambda key: random.uniform(key, shape))(key)
        drawn = jnp.asarray(drawn * np.array(kept.counts.shape)[:, np.newaxis], int)

        def update(number: Any, fitted: tuple[Array, Any]) -> tuple[Array, Any]:
            weights, moments = fitted
            # the first iteration meets each minibatch several times
            places = tuple(drawn[number % learning.updates])
            batch = jax.tree.map(lambda leaf: leaf[places], kept)
            gradient = jax.grad(self._loss)(weights, batch, places[2], learner.scale)
            moves, moments = self._optimizer.update(gradient, moments)
            return weights - step * moves, moments

        count = jnp.where(is_first, learning.first_updates, 1) * learning.updates
        count = jnp.where(jnp.asarray(step) > 0.0, count, 0)
        fitted = lax.fori_loop(0, count, update, (learner.weights, learner.moments))
        return learner._replace(weights=fitted[0], moments=fitted[1])

    def _loss(self, row: Array, batch: Kept, steps: Array, scale: Array) -> Array:
        inputs, weights = jax.vmap(self._values.inputs)(batch.states), self._of_row(row)
        found = jax.vmap(functools.partial(self._values.value, weights))(inputs, steps)
        errors = (found - batch.targets / scale) ** 2
        return jnp.sum(batch.counts * errors) / (jnp.sum(batch.counts) + _TINY)

    def _each(self, row: Array, states: dict[str, Array]) -> Array:
        """The scaled value of each state of each rollout [B, H]."""
        inputs = jax.vmap(jax.vmap(self._values.inputs))(states)
        one = functools.partial(self._values.value, self._of_row(row))
        return jax.vmap(jax.vmap(one), in_axes=(0, None))(inputs, self._steps)


def _while_alive(played: Explored) -> dict[str, Array]:
    """The states, zero after the end: they may be no numbers there, which no weight takes out."""

    def kept(leaf: Array) -> Array:
        alive = played.alive.reshape(played.alive.shape + (1,) * (leaf.ndim - 2))
        return jnp.where(alive > 0.0, leaf, jnp.zeros_like(leaf))

    return {name: kept(leaf) for name, leaf in played.states.items()}


def _zeros(shape: tuple[int, ...], dtype: Any) -> Array:
    """`jnp.zeros`, for which nothing is compiled."""
    return jax.device_put(np.zeros(shape, dtype))


def _pushed(is_first: Array, kept: Array, new: Array) -> Array:
    """What is kept with what is new at its end; the first is all there is."""
    later = jnp.concatenate([kept[1:], new[jnp.newaxis].astype(kept.dtype)])
    return jnp.where(is_first, new.astype(kept.dtype), later)


def _is_finite(tree: Any) -> Array:
    leaves = jax.tree.leaves(tree)
    return functools.reduce(jnp.logical_and, [jnp.all(jnp.isfinite(leaf)) for leaf in leaves])
