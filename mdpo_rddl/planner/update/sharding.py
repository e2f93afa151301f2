"""Restarts spread over the devices that JAX shows."""

from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec


def restart_sharding(restarts: int) -> NamedSharding | None:
    """How to lay a leading axis of restarts over the devices, or None for one device.

    Every device gets the same number, so that as many devices take part as divide the
    restarts. None of the computation crosses restarts, so the devices do not wait for each
    other.
    """
    if getattr(jax.config, "jax_default_device", None) is not None:
        return None
    devices = jax.local_devices()
    shares = [n for n in range(1, len(devices) + 1) if restarts % n == 0]
    if shares[-1] == 1:
        return None
    mesh = Mesh(np.array(devices[: shares[-1]]), ("restarts",))
    return NamedSharding(mesh, PartitionSpec("restarts"))


def replicated(sharding: NamedSharding) -> NamedSharding:
    """The same devices, each with a copy of the whole."""
    return NamedSharding(sharding.mesh, PartitionSpec())


def shard(tree: Any, sharding: NamedSharding | None) -> Any:
    """The tree with its leading axis laid out; as it is where there is nothing to lay out."""
    return tree if sharding is None else jax.device_put(tree, sharding)
