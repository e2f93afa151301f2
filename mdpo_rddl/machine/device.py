"""The device on which JAX computes: for a block of code, and for other threads' work."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import jax


def chosen_device() -> Any:
    """What `computing_on`, `jax.default_device` or the user has set here; None if nothing is."""
    return getattr(jax.config, "jax_default_device", None)


def computing_on(device: Any) -> AbstractContextManager[Any]:
    """A block in which that device is JAX's default, in this thread.

    Args:
      device: a `jax.Device` or a platform's name, or None for the one that JAX puts first.
    """
    return jax.default_device(device)


def as_here(task: Callable[[], None]) -> Callable[[], None]:
    """The same task for another thread, with this one's default device there."""
    device = chosen_device()

    def on_it() -> None:
        with computing_on(device):
            task()

    return on_it


def current_device() -> jax.Device:
    """Where JAX computes here what is bound to no device."""
    chosen = chosen_device()
    if isinstance(chosen, jax.Device):
        return chosen
    return jax.devices(chosen)[0]


def is_on_cpu() -> bool:
    """Whether that is a CPU."""
    return current_device().platform == "cpu"
