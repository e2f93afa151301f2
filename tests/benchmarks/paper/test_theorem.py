"""The evidence for Theorem 1: on a problem whose gradient is known, and its table."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner, tiny_files

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.paper import theorem
from benchmarks.paper.perturbed_returns import perturbed_mean_return
from mdpo_rddl import ConstantNoise, MDPOPlanner
from mdpo_rddl.problem.load import load_problem

SIGMA = 0.1


def test_the_mean_return_and_its_gradient_are_the_known_ones(tmp_path):
    """Far from the box, x_t = sum of the pushes u and their noise, and r_t = -(x_t - g)^2."""
    problem = load_problem(*tiny_files(tmp_path, horizon=3))
    noise = ConstantNoise(SIGMA, unit="absolute")
    planner = make_planner(
        MDPOPlanner, problem, make_plan("slp"), noise=noise, batch_size_train=4000
    )
    plan = jnp.array([[0.1, 0.3], [0.2, -0.1], [0.0, 0.0]])
    mean_return = perturbed_mean_return(planner, SIGMA)
    value, gradient = jax.value_and_grad(mean_return, argnums=1)(
        jax.random.PRNGKey(0), {"push": plan}
    )
    positions = np.cumsum(np.vstack([np.zeros(2), plan]), axis=0)[:3] - 0.5
    # two units, whose variances after 1 and 2 steps are sigma^2 and 2 sigma^2
    assert value == pytest.approx(-(positions**2).sum() - 2 * 3 * SIGMA**2, rel=0.02)
    expected = -2 * np.array([positions[1] + positions[2], positions[2], [0.0, 0.0]])
    np.testing.assert_allclose(gradient["push"], expected, atol=0.02)


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(theorem, "MODELS", (theorem.Model(1.0, True),))
    monkeypatch.setattr(theorem, "HORIZON", 2)
    monkeypatch.setattr(theorem, "_TRAINING", 2)


@pytest.mark.long
def test_bench_compares_the_two_derivatives(small, tmp_path, capsys):
    arguments = ["theorem", "--batches", "4", "--out", str(tmp_path)]
    assert bench.main(arguments) == 0
    table = capsys.readouterr().out
    rows = Records(tmp_path / "theorem.csv", theorem.COLUMNS, theorem.KEYS).rows
    assert [row["direction"] for row in rows] == [str(d) for d in range(theorem.DIRECTIONS)]
    for row in rows:
        gap = float(row["gradient"]) - float(row["difference"])
        errors = float(row["gradient_error"]) + float(row["difference_error"])
        assert abs(gap) < 5 * errors
        assert f"{row['gradient']} ± {row['gradient_error']}" in table
    assert (tmp_path / "table.md").read_text() == table
    written = (tmp_path / "theorem.csv").read_bytes()
    assert bench.main(arguments) == 0
    assert (tmp_path / "theorem.csv").read_bytes() == written
    assert bench.main([*arguments[:2], "5", *arguments[3:]]) == 2
    assert "made with another batches" in capsys.readouterr().err
