"""The sensitivity study at a size for tests, and noise behind the projection."""

from typing import Any

import jax
import jax.numpy as jnp
import pytest
from helpers.problems import make_plan, make_planner, tiny_files

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.paper import exact, sensitivity
from benchmarks.paper.perturbed_returns import perturbed_mean_return
from mdpo_rddl import ConstantNoise, MDPOPlanner
from mdpo_rddl.problem.load import load_problem

FACTORS = {"sigma_max": (0.5,), sensitivity.ENTRY: (sensitivity.AFTER,)}
SIZE = ["--seeds", "2", "--iterations", "6", "--rollouts", "2"]


@pytest.fixture
def toy(tmp_path_factory, monkeypatch):
    problem = load_problem(*tiny_files(tmp_path_factory.mktemp("tiny"), spread=0.1))
    monkeypatch.setattr(exact, "load_setting", lambda name: problem)
    monkeypatch.setattr(sensitivity, "FACTORS", FACTORS)
    exact.problem_of.cache_clear()
    exact.exact_problem.cache_clear()
    yield
    exact.problem_of.cache_clear()
    exact.exact_problem.cache_clear()


@pytest.mark.long
def test_every_choice_is_tried_by_itself(toy, tmp_path, capsys, monkeypatch):
    arguments = ["paper-sensitivity", "--settings", "powergen7", "--out", str(tmp_path), *SIZE]
    assert bench.main([*arguments, "--factors", "sigma_max"]) == 0
    assert capsys.readouterr().out.count("\n| ") == 2
    # the rest of them later
    records = sensitivity.run_sensitivity(tmp_path, ["powergen7"], FACTORS, 2, 6, 2)
    rows = [(row["factor"], row["value"], row["seed"]) for row in records.rows]
    variants = [
        (sensitivity.BASE, ""),
        ("sigma_max", "0.5"),
        (sensitivity.ENTRY, sensitivity.AFTER),
    ]
    assert rows == [(*variant, seed) for variant in variants for seed in ("0", "1")]
    returns = [float(row["last_5"]) for row in records.rows]
    assert set(returns[:2]).isdisjoint(returns[2:4])
    monkeypatch.setattr(sensitivity, "train_by_gradient", None)
    again = sensitivity.run_sensitivity(tmp_path, ["powergen7"], FACTORS, 2, 6, 2)
    assert again.rows == records.rows


@pytest.mark.parametrize(
    ("planner_class", "is_woken"), [(MDPOPlanner, True), (sensitivity.LatePlanner, False)]
)
def test_behind_the_projection_noise_cannot_wake_a_clipped_plan(tmp_path, planner_class, is_woken):
    problem = load_problem(*tiny_files(tmp_path))
    noise, plan = ConstantNoise(2.0), {"push": jnp.full((4, 2), 3.0)}
    planner = make_planner(
        planner_class, problem, make_plan("slp"), noise=noise, batch_size_train=50
    )
    mean_return = perturbed_mean_return(planner, 2.0)
    gradient = jax.grad(mean_return, argnums=1)(jax.random.PRNGKey(1), plan)["push"]
    assert bool(jnp.any(gradient != 0.0)) == is_woken


def test_the_table_by_hand(tmp_path):
    records = Records(tmp_path / "s.csv", sensitivity.COLUMNS, sensitivity.KEYS)
    rows: list[tuple[Any, ...]] = [
        ("hvac10", "alpha", 1.0, 0, -30.0),
        ("hvac10", sensitivity.BASE, "", 0, -10.0),
        ("hvac10", sensitivity.BASE, "", 1, -20.0),
        ("powergen7", "alpha", 1.0, 0, 5.0),
    ]
    for row in rows:
        records.add(*row)
    assert sensitivity.sensitivity_table(records) == (
        "| factor | value | hvac10 | powergen7 |\n"
        "|---|---|---|---|\n"
        f"| {sensitivity.BASE} |  | -15 ± 7 |  |\n"
        "| alpha | 1.0 | -30 ± 0 | 5 ± 0 |\n"
    )
