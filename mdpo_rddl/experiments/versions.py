"""The versions that a result depends on."""

import importlib.metadata
import platform

_PACKAGES = ("pyRDDLGym", "pyRDDLGym-jax", "rddlrepository", "jax", "tensorflow-probability")


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
