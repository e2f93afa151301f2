"""A law of bools of which at most k are true: independent ones, given that they are so few."""

import jax
import jax.numpy as jnp
from jax import Array, lax, random

_TINY = 1e-9


class FewTrue:
    """Sets of at most k of n bools, where S has probability exp(sum of S's weights) / Z.

    Z is the sum over all such sets. The conditional Bernoulli law of Chen, Dempster and Liu
    (1994), "Weighted finite population sampling to maximize entropy", with "at most" in place of
    "exactly": for k = n the bools are independent and the weights their log-odds; for k = 1 it is
    a softmax with one more class, none, of weight 0. The likeliest set has the k largest weights
    that are positive.

    Attributes:
      size: bools n.
      most: of them true at the same time, k.
    """

    def __init__(self, size: int, most: int) -> None:
        """Names the sets.

        Args:
          size: bools n.
          most: of them that may be true; n if more are named.

        Raises:
          ValueError: if none may be true, or there is none.
        """
        if size < 1 or most < 1:
            raise ValueError(f"size >= 1 and most >= 1 must hold, got {size} and {most}")
        self.size, self.most = size, min(size, most)

    def noise(self, key: Array, shape: tuple[int, ...]) -> Array:
        """What `draw` makes sets of [*shape, n or n + 1]."""
        if self.most == 1:
            return random.gumbel(key, (*shape, 1 + self.size))
        return random.uniform(key, (*shape, self.size))

    def draw(self, noise: Array, weights: Array) -> Array:
        """A set, as bools [n].

        Args:
          noise: of one set, by `noise`.
          weights: of its elements [n].
        """
        if self.most == 1:
            place = jnp.argmax(_with_none(weights) + noise)
            return jnp.arange(1, 1 + self.size) == place
        if self.most == self.size:
            return noise < jax.nn.sigmoid(weights)
        sums = self._log_sums(weights)

        def decide(left: Array, element: tuple[Array, ...]) -> tuple[Array, Array]:
            uniform, weight, now, after = element
            with_it = weight + after[jnp.maximum(left - 1, 0)] - now[left]
            is_true = (left > 0) & (uniform < jnp.exp(with_it))
            return left - is_true, is_true

        elements = noise, weights, sums[:-1], sums[1:]
        return lax.scan(decide, jnp.array(self.most), elements)[1]

    def ranks(self, noise: Array, weights: Array) -> Array:
        """In which order other limits keep elements of a drawn set [n]: the larger, the sooner.

        The weights, and noise where several may be drawn, so that it is not always the same one.
        """
        return weights if self.most == 1 else weights + jnp.log1p(-noise) - jnp.log(noise + _TINY)

    def log_probability(self, weights: Array, chosen: Array) -> Array:
        """Of a set, given as bools [n], under weights [n]."""
        return jnp.sum(jnp.where(chosen, weights, 0.0)) - self._log_total(weights)

    def entropy(self, weights: Array) -> Array:
        """In nats, under weights [n]."""
        # the derivatives of log Z are the probabilities of the bools
        total, true = jax.value_and_grad(self._log_total)(weights)
        return total - jnp.sum(true * weights)

    def _log_total(self, weights: Array) -> Array:
        """log Z."""
        if self.most == 1:
            return jax.nn.logsumexp(_with_none(weights))
        if self.most == self.size:
            return jnp.sum(jax.nn.softplus(weights))
        return self._log_sums(weights)[0, self.most]

    def _log_sums(self, weights: Array) -> Array:
        """log Z of the last n - i bools alone, of which at most c are true, at [i, c]."""

        def add(sums: Array, weight: Array) -> tuple[Array, Array]:
            more = jnp.logaddexp(sums[1:], weight + sums[:-1])
            sums = jnp.concatenate([sums[:1], more])
            return sums, sums

        none = jnp.zeros(1 + self.most, weights.dtype)
        sums = lax.scan(add, none, weights, reverse=True)[1]
        return jnp.concatenate([sums, none[jnp.newaxis]])


def _with_none(weights: Array) -> Array:
    return jnp.concatenate([jnp.zeros(1, weights.dtype), weights])
