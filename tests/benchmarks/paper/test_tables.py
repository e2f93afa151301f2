"""The paper's table from made-up results, worked by hand."""

import json

import numpy as np
import pytest

from benchmarks.common.table1 import TABLE
from benchmarks.paper.cells import Trained
from benchmarks.paper.iterates import kept_iterations
from benchmarks.paper.tables import (
    Measured,
    as_csv,
    as_json,
    as_markdown,
    make_overall,
    make_rows,
)


def cell(last_five: list[list[float]], played: list[list[float]]) -> Measured:
    """Seeds with an earlier iterate that must not count, and two rollouts around the last one."""
    returns = np.array([[-1e9, *values] for values in last_five])
    last = returns[:, -1:] + np.array([-10.0, 10.0])
    seconds = {"compile": 1.0, "train": 20.0, "evaluate": 0.5}
    kept = [1, 6, 7, 8, 9, 10]
    elapsed = [0.1 * i for i in kept]
    trained = Trained({}, seconds, kept, elapsed, returns, last, None)
    return Measured(trained, np.array(played), 2.0)


MEASURED = {
    ("powergen7", "ppo"): cell([[-119950.01] * 5] * 2, [[-119940.0, -119960.0]] * 2),
    ("powergen7", "adaptive"): cell(
        [[8000.0, 9000.0, 10000.0, 11000.0, 12000.0], [14000.0] * 5],
        [[5000.0, 6000.0], [5000.0, 6000.0]],
    ),
}


def test_a_cell_by_hand():
    ppo, adaptive = make_rows(MEASURED)
    assert (ppo.setting, ppo.method, ppo.seeds) == ("powergen7", "ppo", 2)
    assert ppo.mean == pytest.approx(-119950.01)
    assert (ppo.std, ppo.deviations) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert ppo.adaptive_p == 0.25  # of 2^2 arrangements of two signs, one
    assert adaptive.adaptive_p is None
    # 10,000 and 14,000: mean 12,000, deviation sqrt(2) * 2,000
    assert (adaptive.mean, adaptive.std) == pytest.approx((12000.0, 2828.427))
    paper = TABLE["powergen7", "adaptive"]
    assert adaptive.deviations == pytest.approx((12000.0 - paper.mean) / paper.std)
    assert adaptive.compiled == pytest.approx(13000.0)
    assert adaptive.numpy == pytest.approx(5500.0)
    assert adaptive.seconds == {"compile": 1.0, "train": 20.0, "evaluate": 0.5, "play": 2.0}


def test_the_two_models_agree_where_their_intervals_overlap():
    assert [row.agree for row in make_rows(MEASURED)] == [True, False]


def test_equal_returns_agree_up_to_single_precision():
    stuck = cell([[-120000.0] * 5] * 2, [[-120000.004] * 2] * 2)
    stuck.trained.last_returns[:] = -120000.0
    (row,) = make_rows({("powergen7", "ppo"): stuck})
    assert row.compiled_ci95 == (-120000.0, -120000.0)
    assert row.agree


def test_scores_over_settings_are_on_the_papers_scale():
    paper = {s: [TABLE[s, m].mean for m in ("ppo", "adaptive")] for s in ("hvac10", "powergen7")}
    measured = {}
    for setting, (low, high) in paper.items():
        middle = (low + high) / 2
        measured[setting, "jaxplan"] = cell([[low] * 5, [high] * 5], [[low] * 2] * 2)
        measured[setting, "adaptive"] = cell([[middle] * 5] * 2, [[middle] * 2] * 2)
    measured["hvac10", "ppo"] = measured["hvac10", "jaxplan"]  # not on every setting
    jaxplan, adaptive = make_overall(measured)
    assert (jaxplan.method, jaxplan.settings, jaxplan.seeds) == ("jaxplan", 2, 2)
    assert jaxplan.iqm == pytest.approx(0.5)
    assert jaxplan.iqm_ci95 == pytest.approx((0.0, 1.0))
    assert adaptive.iqm_ci95 == pytest.approx((0.5, 0.5))


def test_the_tables_files():
    rows, overall = make_rows(MEASURED), make_overall(MEASURED)
    text = as_markdown(rows, overall)
    assert "| powergen7 | adaptive | 2 | 12,000 ± 2,828 | 10,076 ± 3,925 | +0.5 |\n" in text
    assert "| seconds | compile | train | evaluate | play | in all |\n" in text
    assert "| all | 2 | 40 | 1 | 4 | 47 |\n" in text
    lines = as_csv(MEASURED).splitlines()
    assert lines[3] == "powergen7,adaptive,0,10000.00,12000.00,5500.00"
    content = as_json(rows, overall)
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["cells"][1]["mean"] == 12000.0
    assert content["cells"][1]["adaptive_p"] is None


def test_what_is_not_a_number_is_null_in_json():
    lost = cell([[float("nan")] * 5, [1.0] * 5], [[1.0, 2.0]] * 2)
    (row,) = make_rows({("hvac10", "jaxplan"): lost})
    (content,) = as_json([row], [])["cells"]
    assert content["mean"] is None
    assert not content["agree"]


def test_the_published_table_is_the_papers():
    assert len(TABLE) == 36
    assert TABLE["hvac20", "adaptive"] == (-2086875.93, 42832.24)
    assert TABLE["reservoir15", "jaxplan"] == (-688683.95, 205670.07)


@pytest.mark.parametrize(
    ("iterations", "kept"),
    [
        (1, [1]),
        (4, [1, 2, 3, 4]),
        (3000, [1, 2, 5, 10, 20, *range(50, 3000, 50), 2996, 2997, 2998, 2999, 3000]),
        (300, [1, 2, *range(5, 300, 5), 296, 297, 298, 299, 300]),
    ],
)
def test_the_last_iterates_are_always_kept(iterations, kept):
    assert kept_iterations(iterations) == kept
