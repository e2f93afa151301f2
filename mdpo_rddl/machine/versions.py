"""The versions that a result depends on."""

import importlib.metadata
import platform

_PACKAGES = ("pyRDDLGym", "pyRDDLGym-jax", "rddlrepository", "jax", "tensorflow-probability")
_DECISIVE = (
    "mdpo-rddl",
    "pyRDDLGym",
    "pyRDDLGym-jax",
    "rddlrepository",
    "jax",
    "jaxlib",
    "optax",
    "cmaes",
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
