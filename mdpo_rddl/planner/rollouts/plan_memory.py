"""What a rollout, or whoever plays, carries from step to step for a policy that remembers."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

Entries = dict[str, Array]


class PlanMemory(NamedTuple):
    """The memory of a compiled plan: a tree of arrays and a pure function.

    Attributes:
      initial: before the first step, per entry [*shape]; empty if nothing is remembered.
      update: of a memory, a step, the fluents that are known [*shape] and the actions of that
        step, the memory after it.
    """

    initial: Entries
    update: Callable[[Entries, Any, Mapping[str, Array], Mapping[str, Array]], Entries]


def _unchanged(memory: Entries, *_: Any) -> Entries:
    return memory


NO_MEMORY = PlanMemory({}, _unchanged)


def initial_memories(memory: PlanMemory, count: int) -> Entries:
    """The memories of so many rollouts before their first step, per entry [count, *shape]."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *leaf.shape)), memory.initial)
