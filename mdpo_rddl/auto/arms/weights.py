"""Some of a policy's weights as one vector, which a search without gradient wants."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.flatten_util import ravel_pytree

from mdpo_rddl.planner.plans.feedback import Params


class Weights(NamedTuple):
    """A view of the parameters' parts.

    Attributes:
      start: the parts as they are, one vector [D].
      into: the parameters with the parts replaced by a vector [D].
      into_each: the same for vectors [P, D].
    """

    start: np.ndarray
    into: Callable[[Any], Params]
    into_each: Callable[[Any], Params]

    def batch(self, vectors: np.ndarray) -> Params:
        """Parameters with a leading axis of policies, of vectors [P, D]."""
        return self.into_each(np.asarray(vectors, np.float32))


def weights_of(
    params: Params, parts: Sequence[str], varies: Mapping[str, Sequence[bool]] | None = None
) -> Weights:
    """The parts' weights as a vector.

    Args:
      params: of one policy.
      parts: the keys of the parameters that vary; the others stay as they are.
      varies: per action fluent, which of its shared weights vary; all if None.
    """
    varying = {name: params[name] for name in parts}
    start, unravel = ravel_pytree(varying)
    chosen = np.arange(start.size)
    if varies is not None:
        mask = {"shared": {name: jnp.asarray(varies[name], float) for name in varies}}
        chosen = np.flatnonzero(ravel_pytree({name: mask[name] for name in parts})[0])

    def into(vector: Array) -> Params:
        return {**params, **unravel(start.at[chosen].set(vector))}

    return Weights(np.asarray(start[chosen], float), into, jax.jit(jax.vmap(into)))
