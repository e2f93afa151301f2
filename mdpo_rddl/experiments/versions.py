"""The versions that a result depends on."""

import importlib.metadata
import platform

_PACKAGES = ("pyRDDLGym", "pyRDDLGym-jax", "rddlrepository", "jax", "tensorflow-probability")


def versions() -> dict[str, str]:
    """The version of Python and of each package, "none" for one that is not installed."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "none"
    return found
