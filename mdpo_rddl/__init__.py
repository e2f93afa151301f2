"""Plans RDDL problems: a race of methods, MDPO (JaxPlan with action noise) among them.

The public names are imported when they are first used: JAX takes seconds, and a command's
`--help` has no use for it.
"""

import importlib
import logging
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mdpo_rddl.errors import InputError
    from mdpo_rddl.noise import (
        ActionNoise,
        AdaptiveNoise,
        AnnealedNoise,
        ConstantNoise,
        NoiseProfile,
        NoNoise,
    )
    from mdpo_rddl.planner.config.config import (
        PlannerConfig,
        load_config,
        load_config_from_string,
    )
    from mdpo_rddl.planner.planner import MDPOPlanner
    from mdpo_rddl.planner.upstream import (
        JaxDeepReactivePolicy,
        JaxOfflineController,
        JaxOnlineController,
        JaxStraightLinePlan,
    )
    from mdpo_rddl.policy.load import load_policy
    from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
    from mdpo_rddl.policy.policy import Policy
    from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
    from mdpo_rddl.policy.table_policy import TablePolicy
    from mdpo_rddl.problem.evaluation import Evaluation, evaluate
    from mdpo_rddl.problem.load import Problem, load_problem, make_environment
    from mdpo_rddl.session.configuration import load_preset
    from mdpo_rddl.session.in_python import plan
    from mdpo_rddl.session.watch import PlanProgress
    from mdpo_rddl.simulator.rollouts import rollout
    from mdpo_rddl.simulator.simulator import Simulator
    from mdpo_rddl.simulator.vector_env import make_vec

# whoever wants to read what is logged says where it goes
logging.getLogger(__name__).addHandler(logging.NullHandler())

__version__ = "0.2.0"

__all__ = [
    "ActionNoise",
    "AdaptiveNoise",
    "AnnealedNoise",
    "ConstantNoise",
    "Evaluation",
    "InputError",
    "JaxDeepReactivePolicy",
    "JaxOfflineController",
    "JaxOnlineController",
    "JaxStraightLinePlan",
    "LookaheadPolicy",
    "MDPOPlanner",
    "NoNoise",
    "NoiseProfile",
    "PlanProgress",
    "PlannerConfig",
    "Policy",
    "Problem",
    "RelaxedPlanPolicy",
    "Simulator",
    "TablePolicy",
    "evaluate",
    "load_config",
    "load_config_from_string",
    "load_policy",
    "load_preset",
    "load_problem",
    "make_environment",
    "make_vec",
    "plan",
    "rollout",
]

_SOURCES = {
    "errors": ("InputError",),
    "noise": (
        "ActionNoise",
        "AdaptiveNoise",
        "AnnealedNoise",
        "ConstantNoise",
        "NoNoise",
        "NoiseProfile",
    ),
    "planner.config.config": ("PlannerConfig", "load_config", "load_config_from_string"),
    "planner.planner": ("MDPOPlanner",),
    "planner.upstream": (
        "JaxDeepReactivePolicy",
        "JaxOfflineController",
        "JaxOnlineController",
        "JaxStraightLinePlan",
    ),
    "policy.load": ("load_policy",),
    "policy.lookahead.driver": ("LookaheadPolicy",),
    "policy.policy": ("Policy",),
    "policy.relaxed_plan_policy": ("RelaxedPlanPolicy",),
    "policy.table_policy": ("TablePolicy",),
    "problem.evaluation": ("Evaluation", "evaluate"),
    "problem.load": ("Problem", "load_problem", "make_environment"),
    "session.configuration": ("load_preset",),
    "session.in_python": ("plan",),
    "session.watch": ("PlanProgress",),
    "simulator.rollouts": ("rollout",),
    "simulator.simulator": ("Simulator",),
    "simulator.vector_env": ("make_vec",),
}


def __getattr__(name: str) -> Any:
    for module, names in _SOURCES.items():
        if name in names:
            value = getattr(importlib.import_module(f"{__name__}.{module}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
