"""Which parts of a feedback policy have an effect: rollouts compute nothing for the others."""

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.plans.feedback import OUTPUT, Params

_BIAS, _PLAN, _SHARED, _OWN = "bias", "plan", "shared", "own"


def idle_parts(params: Params) -> frozenset[str]:
    """The parts beside the shared weights and the objects' own that have no effect.

    Args:
      params: as `Feedback.initial` makes them.
    """
    others = params.keys() - {_SHARED, _OWN}
    return frozenset(name for name in others if not _has_effect(_deciding(name, params[name])))


def open_loop(params: Params) -> Params | None:
    """The biases and the plan of a policy, if it plays nothing else.

    What is left plays the same, and its rollouts compute no features: they take from three quarters
    to a ninth of the time, and less to compile (`results/part_times`).

    Args:
      params: as `Feedback.initial` makes them.

    Returns:
      The parameters; None of a policy with any other weight that has an effect.
    """
    if any(_has_effect(_deciding(name, part)) for name, part in params.items() if name != _PLAN):
        return None
    own = {name: {_BIAS: entries[_BIAS]} for name, entries in params[_OWN].items()}
    plan = {_PLAN: params[_PLAN]} if _PLAN in params else {}
    return {_OWN: own, **plan}


def with_effect(params: Params) -> Params:
    """The parts of a policy's parameters that have an effect: what is left plays the same.

    Args:
      params: as `Feedback.initial` makes them.
    """
    alone, idle = open_loop(params), idle_parts(params)
    if alone is not None:
        return alone
    return {name: part for name, part in params.items() if name not in idle}


def _has_effect(weights: Iterator[Any]) -> bool:
    return any(np.any(leaf) for each in weights for leaf in jax.tree.leaves(each))


def _deciding(name: str, part: Any) -> Iterator[Any]:
    """The weights of a part, other than biases, without which the rest of it has no effect."""
    if name == _OWN:
        for entries in part.values():
            yield {gain: values for gain, values in entries.items() if gain != _BIAS}
    elif name == "lifted":
        for layer in part.values():
            yield layer["output"]
    elif name == "net":
        yield [layer for key, layer in part.items() if key.startswith(OUTPUT)]
    else:
        yield part
