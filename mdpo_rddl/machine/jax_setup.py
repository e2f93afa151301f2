"""What a command sets up in JAX before it computes anything: most of it without importing JAX."""

import atexit
import contextlib
import gc
import os
import sys
from pathlib import Path
from typing import Any

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.cache import TRACED, bound_cache, cache_folder, grammar_tables
from mdpo_rddl.machine.cores import usable_cores


def keep_compiled_programs() -> Path:
    """Has JAX keep what it compiles for the next run, within a bound.

    Returns:
      A folder for traced programs.
    """
    bound_cache(cache_folder())
    _set("jax_compilation_cache_dir", str(cache_folder()))
    # the many small programs too, which together take as long as a large one
    _set("jax_persistent_cache_min_compile_time_secs", 0.0)
    return cache_folder() / TRACED


def require_devices() -> None:
    """Has JAX begin.

    Raises:
      InputError: if it cannot, such as on the platform that JAX_PLATFORMS names.
    """
    try:
        import jax

        jax.devices()
    except (RuntimeError, AssertionError, ValueError) as error:
        # JAX asserts that a platform was found, without a word, where the one that was named is
        # known but has no device
        named = os.environ.get("JAX_PLATFORMS", "")
        cause = str(error) and one_line_cause(error)
        cause = cause or f"JAX finds no device of JAX_PLATFORMS={named}"
        raise InputError(f"the environment: {cause}") from error


def keep_no_programs() -> None:
    """Has JAX neither read nor write compiled programs, whatever its variables say."""
    _set("jax_compilation_cache_dir", None)


def kept_tables() -> Path | None:
    """`grammar_tables` if this process keeps compiled programs, as a child is told to or not."""
    name = "jax_compilation_cache_dir"
    jax = sys.modules.get("jax")
    folder = os.environ.get(name.upper()) if jax is None else jax.config.values[name]
    return None if folder is None else grammar_tables()


def leave_out_of_collections() -> None:
    """Has Python look through nothing that is there now, and nothing at the end, for garbage.

    What was imported and compiled holds none worth the time that looking takes.
    """
    gc.freeze()
    atexit.register(gc.freeze)


def use_all_cores() -> None:
    """Has JAX show a device for each core, over which a planner spreads its restarts.

    What the user said in JAX_NUM_CPU_DEVICES or XLA_FLAGS stands, and so do the devices with
    which JAX has begun to compute.

    Raises:
      InputError: as `require_devices`.
    """
    given = os.environ.get("JAX_NUM_CPU_DEVICES", "") + os.environ.get("XLA_FLAGS", "")
    if not given:
        with contextlib.suppress(RuntimeError):
            _set("jax_num_cpu_devices", usable_cores())
    require_devices()


def _set(name: str, value: Any) -> None:
    """Sets an option of JAX's: in JAX if it is imported, else where it looks when it is."""
    if (jax := sys.modules.get("jax")) is not None:
        jax.config.update(name, value)
    elif value is None:
        os.environ.pop(name.upper(), None)
    else:
        os.environ[name.upper()] = str(value)
