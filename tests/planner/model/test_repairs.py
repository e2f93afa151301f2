"""What JaxPlan's compilers cannot compile: the same values and laws as in the environment."""

import jax
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import problem_from

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.model.repairs import Repairs, repaired
from mdpo_rddl.planner.training.training import train
from mdpo_rddl.planner.upstream import INVALID_PARAMETERS, logic
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

TANK = """domain tank {
    types { part : object; };
    pvariables {
        SHARE(part) : { non-fluent, real, default = 0.5 };
        height : { state-fluent, real, default = 0.8 };
        VALUE(part) : { non-fluent, real, default = 1.0 };
        trials : { state-fluent, int, default = 3 };
        seen(part) : { state-fluent, int, default = 2 };
        drawn(part) : { interm-fluent, int };
        pump : { action-fluent, real, default = 0.0 };
    };
    cpfs {
        drawn(?p) = DRAWN;
        height' = HEIGHT;
        trials' = 2 + ((sum_{?p : part} [seen(?p)]) > 3);
        seen'(?p) = drawn(?p);
    };
    reward = height - 0.1 * pump + (sum_{?p : part} [VALUE(?p) * drawn(?p)]);
    action-preconditions { pump >= 0.0; pump <= 1.0; };
}
non-fluents n {
    domain = tank; objects { part : {p1, p2}; }; non-fluents { VALUE(p1) = 2.0; };
}
instance i {
    domain = tank; non-fluents = n; max-nondef-actions = pos-inf; horizon = 6; discount = 1.0;
}
"""
LEVELS = {
    "ln": "ln[1.5 + height] + pump",
    "gamma": "gamma[1.5 + 0.5 * height] + pump",
    "a law": "0.5 * height + pump + Gamma(2.0, 0.5)",
}
LAWS = {
    "NegativeBinomial": "NegativeBinomial(2.5, SHARE(?p))",
    "NegativeBinomial of the state": "NegativeBinomial(1.0 + seen(?p), 0.6)",
    "Multinomial": "Multinomial[?p](trials, SHARE(_))",
}


def problem_of(height="height + pump", drawn="1"):
    return problem_from(TANK.replace("HEIGHT", height).replace("DRAWN", drawn))


def planner_of(problem):
    return build_planner(problem, without_scales(preset(1.0))).planner


@pytest.mark.parametrize(
    ("height", "drawn"),
    [(LEVELS["ln"], "1"), (LEVELS["gamma"], "1"), (LEVELS["a law"], "1")]
    + [("height + pump", law) for law in LAWS.values()],
)
def test_it_returns_what_the_environment_does(height, drawn):
    problem = problem_of(height, drawn)
    planner = planner_of(problem)
    one = jax.tree.map(lambda leaf: np.asarray(leaf)[np.newaxis], planner.feedback_plan.noop(0))
    returns = np.asarray(compile_exact_returns(planner, 1000)(jax.random.PRNGKey(0), one))[0]
    played = evaluate(make_environment(problem), lambda step, state: {}, 200, seed=0).returns
    error = np.hypot(np.std(returns) / np.sqrt(1000), np.std(played) / np.sqrt(200))
    assert abs(np.mean(returns) - np.mean(played)) < 4.0 * error + 1e-4
    if error > 1e-6:
        assert 0.8 < np.std(returns) / np.std(played) < 1.25


@pytest.mark.parametrize(
    ("height", "drawn"),
    [
        (LEVELS["ln"], "1"),
        (LEVELS["gamma"], "1"),
        ("height + pump", LAWS["Multinomial"]),
        ("height + pump", LAWS["NegativeBinomial"]),
        pytest.param(
            "height + pump", LAWS["NegativeBinomial of the state"], marks=pytest.mark.long
        ),
    ],
)
def test_gradients_train_on_it(height, drawn):
    problem = problem_of(height, drawn)
    config = PRESETS["paper"]("tank").with_values("Optimize", epochs=2)
    result = train(build_planner(problem, config), jax.random.PRNGKey(0), Budget(2, 60.0))
    assert np.isfinite(result.best_return)


@pytest.mark.parametrize(
    ("trials", "height", "is_law"),
    [(4, 0.5, True), (4, 1.5, False), (4, -0.1, False), (2, 0.5, False)],
)
def test_what_is_no_law_is_an_error(trials, height, is_law):
    model = planner_of(problem_of(drawn="NegativeBinomial(trials - 2.0, height)")).test_compiled
    transition = model.compile_transition(check_constraints=True, cache_path_info=False)
    fluents, nonfluents = model.split_fluent_nonfluent(model.init_values)
    fluents = {**fluents, "trials": np.array(trials), "height": np.array(height)}
    given = {"pump": np.zeros(())}, fluents, nonfluents, model.model_aux["params"]
    _, log, _ = transition(jax.random.PRNGKey(0), *given)
    assert (int(log["error"]) & INVALID_PARAMETERS == 0) == is_law


def test_a_configured_compiler_keeps_its_name_and_what_it_relaxes():
    config = jaxplan_config("default", "slp")
    compiled = build_planner(problem_of(), config).planner.compiled
    assert type(compiled).__name__ == logic.DefaultJaxRDDLCompilerWithGrad.__name__
    assert isinstance(compiled, Repairs)
    assert isinstance(compiled, logic.DefaultJaxRDDLCompilerWithGrad)
    assert repaired(logic.DefaultJaxRDDLCompilerWithGrad) is type(compiled)
