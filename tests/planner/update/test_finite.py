"""Parameters that are no numbers are neither kept nor the best, and no action is one of them."""

import logging

import jax
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner, optimize
from helpers.toys import problem_from

from mdpo_rddl.noise import ConstantNoise, NoNoise
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.update.finite import FiniteBest, without_lost_updates

# the gradient of the root is infinite at 0, in a branch whose weight is 0 there
DITCH = """domain ditch {
    pvariables {
        water : { state-fluent, real, default = 0.0 };
        pump : { action-fluent, real, default = 0.0 };
    };
    cpfs { water' = max[0.0, water + pump - 2.0]; };
    reward = if (water > 0.0) then ln[water] else -20.0;
    action-preconditions { pump >= 0.0; pump <= 1.0; };
}
non-fluents n { domain = ditch; }
instance i {
    domain = ditch; non-fluents = n; max-nondef-actions = pos-inf; horizon = 4; discount = 1.0;
}
"""


def are_finite(tree):
    return all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(tree))


@pytest.mark.parametrize("kind", ["slp", "drp"])
@pytest.mark.parametrize("noise", [NoNoise(), ConstantNoise(0.1)])
def test_a_gradient_without_numbers_leaves_a_policy_that_plays(kind, noise):
    problem = problem_from(DITCH)
    planner = make_planner(MDPOPlanner, problem, make_plan(kind), noise=noise, pgpe=None)
    found = optimize(planner, 3)
    assert not are_finite(found["grad"])
    assert are_finite(found["best_params"])
    lost = jax.tree.map(lambda leaf: np.nan * leaf, found["best_params"])
    action = planner.get_action(jax.random.PRNGKey(0), lost, 0, {"water": np.array(0.0)})
    assert action["pump"] == 0.0


def callback(iteration, params, returns, best):
    """Of two lanes; `best` says what JaxPlan takes for the best one."""
    lane, best_return = best
    return {
        "iteration": iteration,
        "params": {"w": np.array(params)},
        "grad": {"w": np.zeros(2)},
        "test_return": np.array(returns),
        "best_params": {"w": np.array(params[lane])},
        "best_grad": {"w": np.zeros(())},
        "best_return": best_return,
        "best_index": lane,
        "last_iteration_improved": iteration,
    }


def test_the_best_iterate_is_the_best_finite_one(caplog):
    caplog.set_level(logging.WARNING)
    best = FiniteBest(lambda: {"w": np.array([7.0, 8.0])})
    callbacks = [
        callback(0, [np.nan, 1.0], [5.0, -np.inf], (0, 5.0)),  # none is finite and has a return
        callback(1, [np.nan, 2.0], [5.0, 3.0], (0, 5.0)),
        callback(2, [np.nan, 3.0], [6.0, 2.0], (0, 6.0)),
        callback(3, [np.nan, 4.0], [6.0, 9.0], (1, 9.0)),  # JaxPlan's own is finite again
    ]
    found = []
    for each in callbacks:
        best.complete(each)
        found.append((each["best_params"]["w"], each["best_return"], each["best_index"]))
    assert found == [(7.0, -np.inf, 0), (2.0, 3.0, 1), (2.0, 3.0, 1), (4.0, 9.0, 1)]
    assert len(caplog.records) == 1


def test_an_update_that_is_lost_leaves_its_lane_as_it_was():
    def update(key, params, opt_state, opt_aux):
        grad = np.array([1.0, np.nan, np.inf])
        new = params - grad
        log = {"grad": grad}
        return new, None, opt_state + 1.0, {"noise": opt_aux["noise"] + 1.0}, None, log

    given = np.array([5.0, 6.0, 7.0]), np.zeros(3), {"noise": np.zeros(3)}
    with jax.disable_jit():
        params, _, state, aux, *_ = without_lost_updates(update)(None, *given)
    np.testing.assert_array_equal(params, [4.0, 6.0, 7.0])
    np.testing.assert_array_equal(state, [1.0, 0.0, 0.0])
    # the noise goes on with the iterations
    np.testing.assert_array_equal(aux["noise"], [1.0, 1.0, 1.0])
