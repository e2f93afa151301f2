"""How large an action without a box must be."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner
from helpers.toys import problem_from

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.update.action_scales import _constant_play, answering_size

SIZES = np.array([0.0, 1.0, 10.0, 100.0, -1.0, -10.0, -100.0])


@pytest.mark.parametrize(
    ("returns", "size"),
    [
        # the best where one gains
        ([-50.0, -49.0, -20.0, -70.0, -60.0, -60.0, -60.0], 10.0),
        ([-50.0, -60.0, -60.0, -60.0, -50.0, -30.0, -40.0], 10.0),
        # else the largest that costs little
        ([-50.0, -50.1, -51.0, -90.0, -50.1, -70.0, -90.0], 10.0),
        # of those to which the return answers
        ([-50.0, -50.1, -50.2, -50.0, -50.0, -50.0, -50.0], 10.0),
        # where it answers to none, none is too large
        ([-50.0] * 7, 1.0),
        # all do harm, or diverge
        ([-50.0, *[-90.0] * 6], 1e-3),
        ([-50.0, *[-np.inf] * 6], 1e-3),
    ],
)
def test_the_size_by_the_returns_of_constants(returns, size):
    assert answering_size(SIZES, np.array(returns)) == pytest.approx(size)


def test_a_gain_beside_other_actions_counts():
    alone = [-50.0, -50.0, -50.0, -50.0, -50.0, -50.0, -50.0]
    beside = [-60.0, -55.0, -30.0, -5.0, -60.0, -60.0, -60.0]
    assert answering_size(SIZES, np.array([alone, beside])) == 100.0


@pytest.mark.parametrize("ending", ["termination { x > 1.5; };", "state-invariants { x < 1.5; };"])
def test_constants_are_played_to_the_end_of_the_episode(ending):
    problem = problem_from(
        f"""domain d {{
    pvariables {{
        x : {{ state-fluent, real, default = 0.0 }};
        a : {{ action-fluent, real, default = 0.0 }};
    }};
    cpfs {{ x' = x + a; }};
    reward = a;
    {ending}
}}
non-fluents n {{ domain = d; }}
instance inst {{
    domain = d; non-fluents = n; max-nondef-actions = pos-inf; horizon = 9; discount = 1.0;
}}"""
    )
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"))
    play = _constant_play(planner)
    returns = play(jax.random.PRNGKey(0), {"a": jnp.array([0.1, 1.0])})
    np.testing.assert_allclose(returns, [0.9, 2.0], rtol=1e-5)
