"""Caches of the tests' own, shared helpers that are importable, and cheap compilation."""

import gc
import os
import signal
import sys
import zlib
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import pytest
from helpers.caches import use_own_caches
from hypothesis import settings
from packaging.version import Version

# as fast to compile as can be; children inherit it
_FLAGS = ["--xla_backend_optimization_level=0"]
if Version(version("jaxlib")) < Version("0.11.1"):  # a flag that XLA does not know ends the process
    _FLAGS.append("--xla_cpu_use_fusion_emitters=false")
os.environ.setdefault("XLA_FLAGS", " ".join(_FLAGS))
# before anything imports JAX or matplotlib
use_own_caches()
# in the background of a script it would be ignored, and commands would not be interrupted
signal.signal(signal.SIGINT, signal.default_int_handler)
# tracing makes many objects that live on: to look through them all again and again takes long
gc.set_threshold(200_000, 50, 100)

settings.register_profile("few", derandomize=True, database=None, deadline=None, max_examples=25)
settings.load_profile("few")


@pytest.fixture(autouse=True)
def _jax_keeps_its_cache() -> Iterator[None]:
    """What a command says to JAX in this process is undone: the next test has its cache again."""
    yield
    if "jax" in sys.modules:
        import jax

        folder = os.environ["JAX_COMPILATION_CACHE_DIR"]
        if jax.config.values["jax_compilation_cache_dir"] != folder:
            jax.config.update("jax_compilation_cache_dir", folder)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Of the long tests one part of several, where LONG_PART says which: CI takes them in turn."""
    if not (part := os.environ.get("LONG_PART")):
        return
    number, count = map(int, part.split("/"))

    def is_left_out(item: pytest.Item) -> bool:
        is_long = item.get_closest_marker("long") is not None
        return is_long and zlib.crc32(item.nodeid.encode()) % count != number

    config.hook.pytest_deselected(items=[item for item in items if is_left_out(item)])
    items[:] = [item for item in items if not is_left_out(item)]


# its fixtures serve several files
pytest_plugins = ["helpers.plan_command"]
