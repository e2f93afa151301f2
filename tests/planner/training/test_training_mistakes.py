"""Training that diverges, and what cannot be trained."""

import jax
import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.problems import assert_same_bits, tiny_files
from helpers.toy_mdps import lamp
from helpers.trainings import CART, CART_INSTANCE, Scripted, cart_planner, paper_config, trained

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.training.diagnosis import origin
from mdpo_rddl.planner.upstream import JaxRDDLCompiler
from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.race import RaceOptions, race


def test_a_run_without_a_finite_return_is_an_input_error(tmp_path):
    planner = cart_planner(tmp_path, optimizer_kwargs={"learning_rate": 1e30})
    said = one_line(lambda: trained(planner, 50))
    assert said.startswith("training diverged: no finite return in 2 iterations")


def test_what_was_found_before_it_diverged_is_kept(tmp_path):
    # each step overshoots a million-fold, until the square of x overflows
    planner = cart_planner(tmp_path, optimizer="sgd", optimizer_kwargs={"learning_rate": 1e6})
    result, progress = trained(planner, 50)
    assert result.status == "invalid_gradient"
    assert 1 < result.iterations < 10
    assert result.best_iteration == 0
    assert progress[0].best_return == progress[-1].best_return > -np.inf
    till_then, _ = trained(planner, 1)
    assert_same_bits(result.best_params, till_then.last_params)
    assert np.isfinite(jax.tree.leaves(result.best_params)).all()


def test_a_restart_that_diverges_does_not_hide_the_others():
    nan = np.nan
    planner = Scripted([[nan, 5.0, 6.0], [nan, 9.0, 7.0], [nan, -np.inf, 8.0]])
    result, progress = trained(planner, 3)
    assert [p.test_return for p in progress] == [6.0, 9.0, 8.0]
    assert [p.best_return for p in progress] == [6.0, 9.0, 9.0]
    assert (result.best_iteration, float(result.best_params["w"])) == (1, 101.0)
    assert (result.restart, float(result.last_params["w"])) == (1, 201.0)
    assert [record.test_return for record in result.history] == [5.0, 9.0, -np.inf]


def test_of_equal_returns_the_first_is_the_best():
    result, _ = trained(Scripted([[1.0, 4.0], [5.0, 5.0], [5.0, 5.0]]), 3)
    assert (result.best_iteration, float(result.best_params["w"])) == (1, 100.0)
    assert (result.restart, float(result.last_params["w"])) == (0, 200.0)


def test_restarts_that_all_diverge_are_an_input_error():
    said = one_line(lambda: trained(Scripted([[np.nan, -np.inf], [np.inf, np.nan]]), 2))
    assert said.startswith("training diverged: no finite return in 2 iterations")


# --- what cannot be compiled ------------------------------------------------------------


def _refused(self, expr, aux):
    raise NotImplementedError("no hypot")


def test_what_jaxplan_cannot_compile_is_an_input_error_that_names_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(JaxRDDLCompiler, "_jax_hypot", _refused)
    text = CART.replace("x + push;", "x + push + hypot[x, push];")
    assert text != CART
    (tmp_path / "cart.rddl").write_text(text)
    (tmp_path / "one.rddl").write_text(CART_INSTANCE)
    problem = load_problem(str(tmp_path / "cart.rddl"), str(tmp_path / "one.rddl"))
    said = one_line(lambda: build_planner(problem, paper_config()))
    assert said.startswith(f"{tmp_path / 'one.rddl'}: JaxPlan cannot compile it: ")
    assert "no hypot" in said


def test_what_only_shows_in_the_first_iteration_is_an_input_error(tmp_path):
    planner = cart_planner(tmp_path, optimizer_kwargs={"learning_rate": "fast"})
    said = one_line(lambda: trained(planner, 2))
    assert said.startswith("JaxPlan cannot compile the planner: TypeError: ")


# --- where it came from --------------------------------------------------------------------


def diverging(folder, cpf, noise="NoNoise", **values):
    """A problem whose one state follows an expression of its own."""
    text = CART.replace("x' = x + push;", f"x' = {cpf};")
    assert cpf in text
    (folder / "cart.rddl").write_text(text)
    (folder / "one.rddl").write_text(CART_INSTANCE)
    problem = load_problem(str(folder / "cart.rddl"), str(folder / "one.rddl"))
    config = paper_config(method="JaxStraightLinePlan", method_kwargs={})
    return build_planner(problem, config.with_section("Noise", {"method": noise, **values})).planner


def test_the_expression_that_is_not_finite_is_named(tmp_path):
    # 3 and then a number below 0, which has no root
    planner = diverging(tmp_path, "sqrt[x] - 6 + push")
    assert origin(planner, {"push": np.zeros((2,), np.float32)}) == "the cpf of x' at step 2"


def test_a_derivative_that_is_not_finite_is_named(tmp_path):
    planner = diverging(tmp_path, "pow[x - 3.0, 0.5] + push")
    params = {"push": np.zeros((2,), np.float32)}
    assert origin(planner, params) == "the derivative of the cpf of x' at step 1"
    assert "derivative of the cpf of x'" in one_line(lambda: trained(planner, 3))


def test_where_all_is_finite_nothing_is_named(tmp_path):
    planner = diverging(tmp_path, "x + push")
    assert origin(planner, {"push": np.zeros((2,), np.float32)}) is None
    result, _ = trained(planner, 3)
    assert (result.not_finite, result.advice) == (0, None)


def test_a_sensitivity_that_is_not_finite_is_counted(tmp_path):
    # without noise the action is 0, where the root has no slope; with noise it has one
    planner = diverging(tmp_path, "pow[push * push, 0.5]", noise="AdaptiveNoise", sigma_min=0.5)
    guess = {"push": np.zeros((2,), np.float32)}
    result, _ = trained(planner, 1, arguments={"guess": guess})
    assert result.not_finite == 0
    assert result.lost_sensitivities > 0
    assert result.advice is not None
    assert "sensitivities of a step were not finite" in result.advice
    assert "the derivative of the cpf of x' at step 1" in result.advice


def test_a_flat_problem_is_told(tmp_path):
    result, _ = trained(diverging(tmp_path, "x + 0.0 * push"), 3)
    assert result.advice is not None
    assert result.advice.startswith("all gradients were zero")


@pytest.mark.parametrize(
    ("section", "key"), [("Planner", "action_bounds"), ("Optimize", "policy_hyperparams")]
)
def test_values_by_action_name_actions(tmp_path, section, key):
    problem = load_problem(*tiny_files(tmp_path))
    given = {"pusch": 1.0} if section == "Optimize" else {"pusch": (0.0, 1.0)}
    config = paper_config().with_values(section, **{key: given})
    said = one_line(lambda: build_planner(problem, config))
    assert said.endswith(f"[{section}] {key}: there is no action fluent 'pusch'")


def test_a_problem_without_actions_is_told(tmp_path):
    found = load_problem(*tiny_files(tmp_path))
    found.model.action_fluents.clear()
    said = one_line(lambda: build_planner(found, paper_config()))
    assert said == f"{found.domain_path}: it has no action fluent, nothing to plan"


def test_a_problem_without_actions_is_told_before_its_optimum(tmp_path):
    found, stages = lamp(tmp_path, 3), []
    found.model.action_fluents.clear()
    options = RaceOptions(on_stage=stages.append)
    said = one_line(lambda: race(found, auto_preset(""), Budget.of(9.0), 0, options))
    assert said == f"{found.domain_path}: it has no action fluent, nothing to plan"
    assert stages == []


def test_an_integer_of_more_than_32_bits_is_an_input_error_that_names_file_and_expression(tmp_path):
    (tmp_path / "cart.rddl").write_text(CART.replace("x + push;", "x + push * 5000000000;"))
    (tmp_path / "one.rddl").write_text(CART_INSTANCE)
    problem = load_problem(str(tmp_path / "cart.rddl"), str(tmp_path / "one.rddl"))
    said = one_line(lambda: build_planner(problem, paper_config()))
    assert said.startswith(f"{tmp_path / 'cart.rddl'}: the cpf of x', push * 5000000000: the ")
    assert "a real holds it: 5000000000.0" in said
