"""Some of a policy's weights as one vector, which a search without gradient wants."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import jax
import numpy as np

from mdpo_rddl.auto.search.flat import Flat
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.parts import idle_parts


class Weights(NamedTuple):
    """A view of the parameters' parts.

    Attributes:
      start: the parts as they are, one vector [D].
      to_params: the parameters with the parts replaced by a vector [D].
      batch: the same with a leading axis of policies, of vectors [P, D].
      idle: the parts that stay and have no effect, for which rollouts need compute nothing.
    """

    start: np.ndarray
    to_params: Callable[[np.ndarray], Params]
    batch: Callable[[np.ndarray], Params]
    idle: frozenset[str] = frozenset()


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
    flat, start = Flat(varying), Flat.vector(varying)
    chosen = np.arange(start.size)
    if varies is not None:
        mask = {"shared": {name: np.asarray(varies[name]) for name in varies}}
        chosen = np.flatnonzero(Flat.vector({name: mask[name] for name in parts}))

    def replaced(vectors: np.ndarray) -> Params:
        every = np.tile(start, (*np.shape(vectors)[:-1], 1))
        every[..., chosen] = vectors
        return dict(flat.tree(every))

    @cache
    def others(count: int) -> Params:
        rest = {name: params[name] for name in params if name not in varying}
        each = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (count, *np.shape(leaf))), rest)
        return dict(jax.device_put(each))

    def to_params(vector: np.ndarray) -> Params:
        return {**params, **replaced(np.asarray(vector))}

    def batch(vectors: np.ndarray) -> Params:
        return {**others(len(vectors)), **replaced(vectors)}

    idle = idle_parts(params) - varying.keys()
    return Weights(np.asarray(start[chosen], float), to_params, batch, idle)


def flat_vector(params: Params) -> np.ndarray:
    """All parameters of one policy as a vector, by which another one is known for the same."""
    return Flat.vector(params)


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
