"""`mdpo-plan --config drp|slp|replan`: the configuration by the plan's name, run to its end."""

import json
from pathlib import Path

import pytest
from helpers.plan_command import TANKS, run

from mdpo_rddl.planner.config.presets.by_domain import config_for_domain

# JaxPlan's default of either kind trains for long
SMALL = "--iterations 3 --horizon 3 --episodes 2 --batch 2 --no-cache --quiet --json"


@pytest.mark.long
@pytest.mark.parametrize(("kind", "policy"), [("drp", "drp"), ("slp", "slp")])
def test_one_training_by_the_plan_s_name(
    kind: str, policy: str, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = run(f"{TANKS} --config {kind} {SMALL} --out run", capsys).summary
    config = config_for_domain("tanks.rddl", "tanks", kind)
    assert summary["config"] == config.source
    assert (summary["policy"], summary["iterations"], summary["episodes"]) == (policy, 3, 2)
    kept = json.loads((workplace / "run" / "config.json").read_text())
    assert kept["source"] == config.source
    written = kept["sections"]["Planner"]
    assert written["optimizer"] == config.section("Planner")["optimizer"]
    assert written["batch_size_train"] == 2


def test_replanning_by_its_name(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    summary = run(f"{TANKS} --config replan {SMALL} --lookahead 2 --out run", capsys).summary
    config = config_for_domain("tanks.rddl", "tanks", "replan")
    assert (summary["config"], summary["mode"]) == (config.source, "replan")
    assert (summary["decisions"], summary["lookahead"]) == (6, 2)
    assert summary["decision_iterations"] == 3
    assert (workplace / "run" / "decisions.csv").is_file()
