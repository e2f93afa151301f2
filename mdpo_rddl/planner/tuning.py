"""JaxPlan's Bayesian tuning of hyperparameters, with MDPO as the planner that is tuned.

Needs scikit-learn and bayesian-optimization: `pip install '.[tuning]'` in a checkout.
"""

import types
from typing import Any

from mdpo_rddl.planner.config.config import load_config_from_string
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.upstream import import_tuning

tuning = import_tuning()
Hyperparameter = tuning.Hyperparameter
JaxParameterTuning: type[Any] = tuning.JaxParameterTuning

__all__ = ["Hyperparameter", "MDPOParameterTuning"]


class MDPOParameterTuning(JaxParameterTuning):
    """JaxPlan's `JaxParameterTuning`, whose arguments and methods it has, over `MDPOPlanner`.

    The template is a configuration file of `mdpo_rddl.load_config`, so that tags may stand in
    its sections `[Noise]` and `[MDPO]` too:

        [Noise]
        method='AdaptiveNoise'
        sigma_max=SIGMA_TUNE

    with `Hyperparameter("SIGMA_TUNE", 0.0, 10.0, float)`. Workers are processes of their own,
    so the functions of the hyperparameters must be importable, and a script must tune under
    `if __name__ == "__main__":`.
    """


def _over_mdpo(name: str) -> types.FunctionType:
    """JaxPlan's function of that name in its class, with what it names replaced by ours."""
    original = getattr(JaxParameterTuning, name)
    ours = {
        "__name__": __name__,
        "JaxBackpropPlanner": MDPOPlanner,
        "JaxParameterTuning": MDPOParameterTuning,
        "load_config_from_string": load_config_from_string,
    }
    function = types.FunctionType(
        original.__code__, {**vars(tuning), **ours}, name, original.__defaults__
    )
    function.__kwdefaults__ = original.__kwdefaults__
    function.__annotations__ = original.__annotations__
    function.__doc__ = original.__doc__
    # the workers find it by this name
    function.__qualname__ = f"{MDPOParameterTuning.__name__}.{name}"
    return function


MDPOParameterTuning.objective_function = staticmethod(_over_mdpo("objective_function"))
MDPOParameterTuning.build_best_controller = _over_mdpo("build_best_controller")
MDPOParameterTuning.tune = _over_mdpo("tune")
