"""Model-driven policy optimization for RDDL: JaxPlan with adaptive noise on the actions."""

from mdpo_rddl.errors import InputError
from mdpo_rddl.noise import (
    ActionNoise,
    AdaptiveNoise,
    AnnealedNoise,
    ConstantNoise,
    NoiseProfile,
    NoNoise,
)
from mdpo_rddl.planner.config.config import load_config, load_config_from_string
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.upstream import (
    JaxDeepReactivePolicy,
    JaxOfflineController,
    JaxOnlineController,
    JaxStraightLinePlan,
)
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

__version__ = "0.1.0"

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
    "MDPOPlanner",
    "NoNoise",
    "NoiseProfile",
    "Problem",
    "evaluate",
    "load_config",
    "load_config_from_string",
    "load_problem",
    "make_environment",
]
