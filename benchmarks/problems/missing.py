"""What JaxPlan's own planner lacks where it fails, and how to get it; ours does without."""

import importlib.metadata
import traceback

from mdpo_rddl.planner.upstream import compiler

_NEEDS = "the distributions Multinomial and NegativeBinomial need tensorflow-probability"
# tensorflow-probability 0.25, the newest, uses what jax 0.7 removed:
# https://github.com/tensorflow/probability/issues/2009
_INSTALL = "pip install tensorflow-probability 'jax<0.7' 'flax<0.12'"


def missing_package(error: Exception) -> str | None:
    """What the environment lacks and how to get it, if that is why JaxPlan failed."""
    modules = {
        frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__)
    }
    is_inside = any(name.startswith("tensorflow_probability") for name in modules)
    is_absent = isinstance(error, AttributeError) and error.name == "distributions"
    if not (is_inside or is_absent) or _has_distributions():
        return None
    try:
        version = importlib.metadata.version("tensorflow-probability")
    except importlib.metadata.PackageNotFoundError:
        return f"{_NEEDS}, which is not installed; to get it: {_INSTALL}"
    jax_version = importlib.metadata.version("jax")
    return (
        f"{_NEEDS}, but the installed {version} does not work with jax {jax_version} "
        f"(0.25.0 needs jax before 0.7); to get a pair that works: {_INSTALL}"
    )


def _has_distributions() -> bool:
    try:
        return hasattr(compiler.tfp, "distributions")
    except Exception:  # the module loads itself on first use, and fails as it will
        return False
