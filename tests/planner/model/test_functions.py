"""Every function of RDDL in the exact model, at the edges too: the environment's values."""

import jax
import numpy as np
import pytest
from helpers.functions import BEYOND_THE_GROUND, EXPRESSIONS, in_the_environment, side_by_side
from helpers.lakes import preset
from helpers.toys import problem_from

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.problem.load import make_environment

ALL = {**EXPRESSIONS, **BEYOND_THE_GROUND}
REFUSED = """domain refused {
    pvariables {
        i : { state-fluent, int, default = 2 };
        a : { state-fluent, real, default = 0.0 };
        x : { action-fluent, bool, default = false };
    };
    cpfs { i' = -1; a' = EXPRESSION; };
    reward = a;
}
non-fluents n { domain = refused; }
instance i {
    domain = refused; non-fluents = n; max-nondef-actions = 1; horizon = 2; discount = 1.0;
}
"""


def step_of(problem):
    """The next state in the exact model, of the state's fluents that are not the initial ones."""
    model = build_planner(problem, without_scales(preset(1.0))).planner.test_compiled
    transition = model.compile_transition(check_constraints=False, cache_path_info=False)
    initial, nonfluents = model.split_fluent_nonfluent(model.init_values)
    given, key = {"x": np.zeros((), bool)}, jax.random.PRNGKey(0)
    return lambda **state: transition(key, given, {**initial, **state}, nonfluents, {})[0]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_their_values_are_the_environment_s():
    found = step_of(side_by_side(list(ALL.values())))()
    right = in_the_environment(list(ALL.values()))
    wrong = [
        name
        for k, name in enumerate(ALL)
        if not np.allclose(found[f"f{k}"], right[k], rtol=1e-4, atol=1e-5, equal_nan=True)
    ]
    assert wrong == []


@pytest.mark.parametrize("expression", ["pow[2, i]", "gamma[i / 2.0]", "lngamma[i / 2.0]"])
def test_what_the_environment_refuses_is_no_number(expression):
    problem = problem_from(REFUSED.replace("EXPRESSION", expression))
    env, step = make_environment(problem), step_of(problem)
    env.reset(seed=0)
    np.testing.assert_allclose(step()["a"], env.step({})[0]["a"], rtol=1e-5, atol=1e-6)
    with pytest.raises(ArithmeticError):
        env.step({})
    assert np.isnan(step(i=np.array(-1))["a"])
