"""The device on which JAX computes: for a block of code, and for other threads' work."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import jax


def chosen_device() -> Any:
    """What `computing_on`, `jax.default_device` or the user has set here; None if nothing is."""
    import jax

    return getattr(jax.config, "jax_default_device", None)


def computing_on(device: Any) -> AbstractContextManager[Any]:
    """A block in which that device is JAX's default, in this thread.

    Args:
      device: a `jax.Device` or a platform's name, or None for the one that JAX puts first.
    """
    import jax

    return jax.default_device(device)


def as_here(task: Callable[[], None]) -> Callable[[], None]:
    """The same task for another thread, with this one's default device there."""
    device = chosen_device()

    def on_it() -> None:
        with computing_on(device):
            task()

    return on_it


def current_device() -> "jax.Device":
    """Where JAX computes here what is bound to no device."""
    import jax

    chosen = chosen_device()
    if isinstance(chosen, jax.Device):
        return chosen
    return jax.devices(chosen)[0]


def is_on_cpu() -> bool:
    """Whether that is a CPU."""
    return current_device().platform == "cpu"


def device_name() -> str:
    """Where this process computes: on the CPU, as numpy does, unless JAX is imported."""
    return str(current_device()) if "jax" in sys.modules else "cpu"
