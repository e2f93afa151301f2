"""Some of a policy's weights as one vector, which a search without gradient wants."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.flatten_util import ravel_pytree

from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan


class Weights(NamedTuple):
    """A view of the parameters' parts.

    Attributes:
      start: the parts as they are, one vector [D].
      to_params: the parameters with the parts replaced by a vector [D].
      to_each: the same for vectors [P, D].
    """

    start: np.ndarray
    to_params: Callable[[Any], Params]
    to_each: Callable[[Any], Params]

    def batch(self, vectors: np.ndarray) -> Params:
        """Parameters with a leading axis of policies, of vectors [P, D]."""
        return self.to_each(np.asarray(vectors, np.float32))


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

    def to_params(vector: Array) -> Params:
        return {**params, **unravel(start.at[chosen].set(vector))}

    return Weights(np.asarray(start[chosen], float), to_params, jax.jit(jax.vmap(to_params)))


def flat_vector(params: Params) -> np.ndarray:
    """All parameters of one policy as a vector, by which another one is known for the same."""
    return np.asarray(ravel_pytree(params)[0])


def simple_weights(params: Params, plan: FeedbackPlan) -> Weights:
    """The shared weights of a simple rule: linear in the state, the same at all times.

    Args:
      params: of one policy.
      plan: compiled.
    """
    feedback = plan.feedback
    assert feedback is not None
    varies = {}
    for fluent in feedback.action_shapes:
        names = feedback.names(fluent)
        varies[fluent] = [not (n.endswith("^2") or n.startswith("cos(")) for n in names]
    return weights_of(params, ["shared"], varies)
