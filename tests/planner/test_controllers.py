"""JaxPlan's controllers with our planner: replanning, and policies that are played."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import (
    make_plan,
    make_planner,
    optimize,
    tiny_files,
)

from mdpo_rddl import (
    ActionNoise,
    JaxOfflineController,
    JaxOnlineController,
    MDPOPlanner,
    NoiseProfile,
)
from mdpo_rddl.planner.upstream import planner as jaxplan
from mdpo_rddl.problem.load import load_problem, make_environment

SILENT = {"print_summary": False, "print_progress": False}


@pytest.fixture
def tiny(tmp_path):
    return load_problem(*tiny_files(tmp_path))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Counting(ActionNoise):
    """Tells by its sigma how many decisions and iterations its state has seen."""

    scale: float = 1.0

    def initial_state(self, horizon):
        return {"decisions": jnp.zeros(()), "iterations": jnp.zeros(())}

    def advance(self, state):
        return {**state, "decisions": state["decisions"] + 1}

    def profile(self, gradients, state, horizon):
        state = {**state, "iterations": state["iterations"] + 1}
        sigma = self.scale * (100 * state["decisions"] + state["iterations"])
        return NoiseProfile(jnp.full(horizon, sigma), jnp.zeros(horizon)), state


def last_sigmas(controller, problem, decisions):
    state, _ = make_environment(problem).reset(seed=0)
    found = []
    for _ in range(decisions):
        controller.sample_action(state)
        sigma = np.unique(controller.callback["sigma"])
        assert sigma.size == 1
        found.append(float(sigma[0]))
    return found


def test_replanning_moves_the_noise_s_state_and_a_reset_begins_anew(tiny):
    planner = make_planner(
        MDPOPlanner, tiny, make_plan("slp"), noise=Counting(), parallel_updates=2
    )
    arguments = {"key": jax.random.PRNGKey(0), "epochs": 3, **SILENT}
    warm = JaxOnlineController(planner, **arguments)
    # the state goes on where the last decision left it, one decision later
    assert last_sigmas(warm, tiny, 3) == [3.0, 106.0, 209.0]
    warm.reset()
    assert last_sigmas(warm, tiny, 2) == [3.0, 106.0]
    cold = JaxOnlineController(planner, warm_start=False, **arguments)
    assert last_sigmas(cold, tiny, 3) == [3.0, 3.0, 3.0]


def test_another_attempt_at_a_decision_does_not_move_the_noise_s_state_twice(tiny):
    planner = make_planner(MDPOPlanner, tiny, make_plan("slp"), noise=Counting())
    # JaxPlan's controller repeats a decision of no more than two iterations, thrice
    agent = JaxOnlineController(planner, key=jax.random.PRNGKey(0), epochs=2, **SILENT)
    assert last_sigmas(agent, tiny, 3) == [2.0, 104.0, 206.0]


@pytest.mark.parametrize("given", [None, {}])
def test_a_policy_plays_without_its_hyperparameters(tiny, given):
    """JaxPlan's controller has none where it is given parameters, which its preprocessors need."""
    bounds = {"x": (np.full(2, -2.0), np.full(2, 2.0))}
    preprocessor = jaxplan.StaticNormalizer(bounds)
    planner = make_planner(MDPOPlanner, tiny, make_plan("drp"), preprocessor=preprocessor)
    callback = optimize(planner, 3)
    params, key = callback["best_params"], jax.random.PRNGKey(0)
    state = {"x": np.array([0.3, -1.0])}
    full = planner.get_action(key, params, 0, state, callback["policy_hyperparams"])
    np.testing.assert_array_equal(
        planner.get_action(key, params, 0, state, given)["push"], full["push"]
    )
    agent = JaxOfflineController(planner, key=key, params=params)
    agent.reset()
    np.testing.assert_array_equal(agent.sample_action(state)["push"], full["push"])
