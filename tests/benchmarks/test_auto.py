"""The measurement of the preset `auto`: it goes on, and its table compares."""

import json
from types import SimpleNamespace

import pytest
from helpers.lakes import write_lake

from benchmarks.common.auto_variants import VARIANTS
from benchmarks.common.records import Records
from benchmarks.presets.auto import COLUMNS, KEYS, auto_table, run_auto
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.fitting import scaled
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    return write_lake(tmp_path_factory.mktemp("lake"))


def test_the_measurement_goes_on_and_its_table_compares(tmp_path, monkeypatch):
    out = tmp_path / "auto"
    records = run_auto(out, ["powergen7"], ["expert"], seeds=2, seconds=1.0, episodes=2)
    assert [row["planner"] for row in records.rows] == ["expert"]
    monkeypatch.setattr("benchmarks.presets.auto.expert", None)  # nothing is played again
    again = run_auto(out, ["powergen7"], ["expert"], seeds=2, seconds=1.0, episodes=2)
    assert again.rows == records.rows
    with pytest.raises(InputError, match="unknown problem 'powergen8'"):
        run_auto(out, ["powergen8"], ["expert"], seeds=1, seconds=1.0, episodes=2)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_variant_is_a_configuration_of_its_own(variant, lake):
    config = VARIANTS[variant](auto_preset("toy")).without_section("Search")
    seen = SimpleNamespace(
        units={"pump": 1.0}, state_scales={"depth": (0.0, 1.0)}, lookup_scales={}
    )
    planner = build_planner(lake, scaled(config, seen)).planner
    assert isinstance(planner.plan, FeedbackPlan)
    others = [change(auto_preset("toy")) for name, change in VARIANTS.items() if name != variant]
    assert VARIANTS[variant](auto_preset("toy")) not in others


def test_the_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "runs.csv", COLUMNS, KEYS)
    records.add("p", "expert", 0, 2.0, "", 0.0, "", "[1.0, 3.0]")
    records.add("p", "auto", 0, 4.0, 4.0, 9.0, "polished", "[3.0, 5.0]")
    records.add("p", "auto", 1, 6.0, 6.0, 9.0, "polished", "[5.0, 7.0]")
    # of the recipe two seeds with means 2 and 4, of the race 4 and 6: the difference has the
    # standard error sqrt(2) and 2 degrees of freedom
    for seed in range(2):
        text = json.dumps([1.0 + 2 * seed, 3.0 + 2 * seed])
        records.add("p", "recipe", seed, 2.0 + 2 * seed, "", 1.0, "", text)
    expert, auto, recipe = auto_table(records).splitlines()[2:]
    # 3 on both episodes, over two seeds
    assert expert == "| p | expert | 1 | 2.00 | 2.00 | 2.00 | 3.00 [3.00, 3.00] | yes |  |"
    assert auto == "| p | auto | 2 | 5.00 | 4.00 | 5.00 |  |  |  |"
    assert recipe.endswith("| 2.00 [2.00, 2.00] | yes | 2.00 [-4.08, 8.08] |")
