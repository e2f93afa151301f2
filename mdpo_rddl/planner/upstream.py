"""JaxPlan's modules, imported without their noise on standard error."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from types import ModuleType


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hides what JaxPlan prints where the optional dash is missing, and keeps our filters."""
    with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        yield


with _quiet():
    from pyRDDLGym_jax.core import compiler, logic, planner

JaxBackpropPlanner = planner.JaxBackpropPlanner
JaxDeepReactivePolicy = planner.JaxDeepReactivePolicy
JaxOfflineController = planner.JaxOfflineController
JaxOnlineController = planner.JaxOnlineController
JaxPlan = planner.JaxPlan
JaxPlannerStatus = planner.JaxPlannerStatus
JaxPlannerStoppingRule = planner.JaxPlannerStoppingRule
JaxRDDLCompiler = compiler.JaxRDDLCompiler
JaxStraightLinePlan = planner.JaxStraightLinePlan
GaussianPGPE = planner.GaussianPGPE

_CODES = JaxRDDLCompiler.ERROR_CODES
INVALID_PARAMETERS = sum(code for name, code in _CODES.items() if name.startswith("INVALID_PARAM"))
"""The bits of a rollout's `error` that tell of a distribution's parameter outside its domain."""


def import_tuning() -> ModuleType:
    """JaxPlan's module for tuning.

    Raises:
      ImportError: if one of the packages that it needs is missing.
    """
    try:
        with _quiet():
            from pyRDDLGym_jax.core import tuning
    except ModuleNotFoundError as error:
        raise ImportError(
            f"tuning needs the package {error.name}: pip install mdpo-rddl[tuning]"
        ) from error
    return tuning


__all__ = [
    "INVALID_PARAMETERS",
    "GaussianPGPE",
    "JaxBackpropPlanner",
    "JaxDeepReactivePolicy",
    "JaxOfflineController",
    "JaxOnlineController",
    "JaxPlan",
    "JaxPlannerStatus",
    "JaxPlannerStoppingRule",
    "JaxRDDLCompiler",
    "JaxStraightLinePlan",
    "compiler",
    "import_tuning",
    "logic",
    "planner",
]
