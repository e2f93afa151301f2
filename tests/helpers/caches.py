"""Caches in a temporary folder, so that no test reads or writes those of the user."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

_FOLDER = "MDPO_TESTS_CACHES"


def own_caches() -> Path:
    """The folder of this session's caches."""
    return Path(os.environ[_FOLDER])


def use_own_caches() -> None:
    """Points every cache to a folder that goes when the session ends.

    What a test starts inherits it. Each worker of pytest-xdist keeps its compiled programs for
    itself: JAX does not write them at once.
    """
    if _FOLDER not in os.environ:
        folder = tempfile.mkdtemp(prefix="mdpo-tests-")
        os.environ[_FOLDER] = folder
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    worker = own_caches() / os.environ.get("PYTEST_XDIST_WORKER", "main")
    os.environ["XDG_CACHE_HOME"] = str(worker / "cache")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(worker / "jax")
    # tests compile the same programs again and again
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.1"
    os.environ["MPLCONFIGDIR"] = str(own_caches() / "matplotlib")
    os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(worker / "hypothesis")
