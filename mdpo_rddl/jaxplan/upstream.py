"""JaxPlan's modules, imported without their noise on standard error."""

import contextlib
import io
import warnings

with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
    # without the optional dash, JaxPlan prints a traceback on import and goes on
    warnings.simplefilter("ignore")
    from pyRDDLGym_jax.core import logic, planner

JaxBackpropPlanner = planner.JaxBackpropPlanner
JaxDeepReactivePolicy = planner.JaxDeepReactivePolicy
JaxOfflineController = planner.JaxOfflineController
JaxOnlineController = planner.JaxOnlineController
JaxPlan = planner.JaxPlan
JaxStraightLinePlan = planner.JaxStraightLinePlan
GaussianPGPE = planner.GaussianPGPE

__all__ = [
    "GaussianPGPE",
    "JaxBackpropPlanner",
    "JaxDeepReactivePolicy",
    "JaxOfflineController",
    "JaxOnlineController",
    "JaxPlan",
    "JaxStraightLinePlan",
    "logic",
    "planner",
]
