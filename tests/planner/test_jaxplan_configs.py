"""JaxPlan's example configurations: under MDPO without noise they train to the same bits."""

import numpy as np
import pytest
from helpers.problems import FOREVER, JAXPLAN_EXAMPLES, assert_same_bits

from mdpo_rddl import MDPOPlanner, NoNoise, load_config, load_problem
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.planner.upstream import planner as jaxplan


def _slow(*case):
    return pytest.param(*case, marks=pytest.mark.slow)


# Every kind among JaxPlan's examples: slp, drp and replan; real and bool; with and without PGPE,
# clipping, policy hyperparameters as a number and as a dictionary. Of the same kinds, and left
# out for their compile time: HVAC, MountainCar, Quadcopter, Reservoir, UAV, the other files of
# Cartpole, PowerGen, Wildfire and default.
CONFIGS = [
    _slow("Cartpole_Continuous_gym_drp", "CartPole_Continuous_gym", "0"),
    _slow("Cartpole_Continuous_gym_slp", "CartPole_Continuous_gym", "0"),
    _slow("PowerGen_Continuous_drp", "PowerGen_Continuous", "0"),
    ("PowerGen_Continuous_replan", "PowerGen_Continuous", "0"),
    _slow("Wildfire_MDP_ippc2014_drp", "Wildfire_MDP_ippc2014", "1"),
    ("Wildfire_MDP_ippc2014_slp", "Wildfire_MDP_ippc2014", "1"),
    ("default_replan", "CartPole_Continuous_gym", "0"),
]


@pytest.mark.parametrize(("config", "domain", "instance"), CONFIGS)
def test_a_config_of_jaxplan_trains_to_the_same_bits(config, domain, instance):
    problem = load_problem(domain, instance, horizon=4)
    path = str(JAXPLAN_EXAMPLES / "configs" / f"{config}.cfg")
    callbacks = []
    for planner_class, load, extra in (
        (JaxBackpropPlanner, jaxplan.load_config, {}),
        (MDPOPlanner, load_config, {"noise": NoNoise()}),
    ):
        planner_args, _, train_args = load(path)
        planner_args |= {"batch_size_train": 2, "batch_size_test": 2, **extra}
        if planner_args.get("rollout_horizon", 0) > 5:
            planner_args["rollout_horizon"] = 5
        planner_args["compiler_kwargs"]["print_warnings"] = False
        train_args |= {
            "epochs": 5,
            "train_seconds": FOREVER,
            "print_summary": False,
            "print_progress": False,
        }
        planner = planner_class(rddl=problem.model, **planner_args)
        callbacks.append(planner.optimize(**train_args))
    theirs, ours = callbacks
    assert set(ours) == set(theirs) | {"sigma", "sensitivity"}
    for key in ("params", "best_params", "pgpe_params", "train_return", "test_return", "grad"):
        assert_same_bits(ours[key], theirs[key])
    assert ours["status"] is theirs["status"]
    assert not np.any(ours["sigma"])
