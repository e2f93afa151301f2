"""The versions that a result depends on."""

import importlib.metadata
import platform
import subprocess
from pathlib import Path

_PACKAGES = ("pyRDDLGym", "pyRDDLGym-jax", "rddlrepository", "jax", "tensorflow-probability")
_DECISIVE = (
    "mdpo-rddl",
    "pyRDDLGym",
    "pyRDDLGym-jax",
    "rddlrepository",
    "jax",
    "jaxlib",
    "optax",
    "numpy",
    "scipy",
    "safetensors",
)


def versions(*more: str) -> dict[str, str]:
    """The version of Python and of each package, "none" for one that is not installed.

    Args:
      *more: packages beside the usual ones.
    """
    found = {"python": platform.python_version()}
    for package in (*_PACKAGES, *more):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "none"
    return found


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the results."""
    versions = {name: importlib.metadata.version(name) for name in _DECISIVE}
    return {"python": platform.python_version(), **versions}


def commit() -> str:
    """The commit of the checkout that the package runs from; "none" outside of one.

    A "+" follows where files of the package differ from it.
    """
    here = Path(__file__).resolve().parents[1]
    try:
        name = _git(here, "rev-parse", "--short=7", "HEAD")
        changes = _git(here, "status", "--porcelain", "--untracked-files=no", "--", ".")
    except (OSError, subprocess.SubprocessError):
        return "none"
    return name + ("+" if changes else "")


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10.0)
    return done.stdout.strip()
