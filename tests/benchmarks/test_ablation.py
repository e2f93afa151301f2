"""The race without its arms: what is run, and what the table says of it."""

import json

import pytest

from benchmarks import main as bench
from benchmarks.common.auto_variants import VARIANTS
from benchmarks.common.records import Records
from benchmarks.tasks.ablation import ablation_table, arms_of, make_variant, run_ablation
from benchmarks.tasks.trial import COLUMNS, KEYS, Conditions, Task
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc import mdpo

QUICK = Conditions(seconds=1.0, episodes=3, memory_gb=4.0)
TOY = Task("Toy", "1")


def add(records, task, planner, returns=(), arms="", seed=0):
    row = {"status": "ok" if returns else "timeout", "arms": arms, "returns": json.dumps(returns)}
    key = (task.problem, task.instance, planner, seed)
    records.add(*key, *(row.get(name, "") for name in COLUMNS[len(KEYS) :]))


def test_an_arm_is_left_out_where_it_had_a_part_in_the_policy(tmp_path, monkeypatch):
    asked = []

    def run(out, tasks, planners, seeds, conditions, make):
        assert make is make_variant
        asked.append((tasks[0].problem, *planners))
        records = Records(out / "rows.csv", COLUMNS, KEYS)
        arms = "random rules; shared weights; gradient"
        for planner in planners:
            add(records, tasks[0], planner, [1.0, 2.0], arms if tasks[0] == TOY else "noise")
        return records

    monkeypatch.setattr("benchmarks.tasks.ablation.run_tasks", run)
    other = Task("Other", "1")
    run_ablation(tmp_path, [TOY, other], 1, QUICK)
    assert asked == [
        ("Toy", "auto"),
        (
            "Toy",
            "auto-without-random-rules",
            "auto-without-shared-weights",
            "auto-without-gradient",
            "auto-without-noise",
        ),
        ("Other", "auto"),
        ("Other",),
    ]
    asked.clear()
    run_ablation(tmp_path / "second", [TOY, other], 1, QUICK, (1, 2))
    assert {task for task, *_ in asked} == {"Other"}
    asked.clear()
    run_ablation(tmp_path / "third", [TOY], 1, QUICK, arms=["own weights", "gradient"])
    assert asked[1] == ("Toy", "auto-without-own-weights", "auto-without-gradient")
    with pytest.raises(InputError, match="'weights' is none of the arms dynamic programming, "):
        run_ablation(tmp_path, [TOY], 1, QUICK, arms=["weights"])


def test_only_the_whole_races_arms_count(tmp_path):
    records = Records(tmp_path / "rows.csv", COLUMNS, KEYS)
    add(records, TOY, "auto", [1.0], "plans; own weights; own weights")
    add(records, TOY, "auto", [1.0], "luck", seed=1)
    add(records, TOY, "auto-without-plan", [1.0], "greedy")
    assert arms_of(records.rows) == ["plans", "own weights"]


def test_the_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "rows.csv", COLUMNS, KEYS)
    add(records, TOY, "auto", [4.0, 6.0])
    add(records, TOY, "auto", [6.0, 8.0], seed=1)
    add(records, TOY, "auto-without-plan", [1.0, 3.0])
    add(records, TOY, "auto-without-plan", [3.0, 5.0], seed=1)  # 3 less on both episodes
    add(records, TOY, "auto-without-shooting", [0.0, 20.0])
    add(records, TOY, "auto-without-greedy", [9.0, 11.0])
    add(records, TOY, "auto-without-noise")
    add(records, TOY, "auto-without-luck", [5.0, 7.0])  # no arm any more
    hvac = Task("hvac10")
    add(records, hvac, "auto", [1.0, 1.0])
    add(records, hvac, "auto-without-plan", [1.0, 1.0])
    table = ablation_table(records)
    assert table.startswith("2 tasks, seeds of each: 2.")
    assert "| plan | 2 | 1 | 1 | 0 |" in table
    assert "| greedy | 1 | 0 | 0 | 1 |" in table
    assert "| shooting | 1 | 0 | 1 | 0 |" in table
    assert "| luck | 1 | 0 | 1 | 0 |" in table
    assert "| adaptive noise | 1 | 1 | 0 | 0 |" in table
    assert "| Toy | 1 | plan | 6 | 3 | 3 [3, 3] | worse |" in table
    assert "| Toy | 1 | adaptive noise | 6 | failed |  | worse |" in table
    assert "| hvac10 |  | plan | 1 | 1 | 0 [0, 0] | as good |" in table


def test_a_variant_is_the_race_with_a_changed_configuration(monkeypatch):
    seen = []

    def plan(problem, config, budget, seed):
        seen.append(config.section("Search")["without"])
        raise InputError("enough")

    monkeypatch.setattr(mdpo, "race", plan)

    class Domain:
        domain_name = "toy"

    for name in ("auto-without-shared-weights", "auto-without-dynamic-programming"):
        assert name in VARIANTS
        with pytest.raises(InputError, match="enough"):
            make_variant(name).prepare(Domain(), 10.0, 0)
    assert seen == [["shared weights"], ["dynamic programming"]]


def test_the_command_prints_the_table(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "benchmarks.tasks.ablation.run_tasks",
        lambda out, *_: Records(out / "rows.csv", COLUMNS, KEYS),
    )
    words = ["ablation", "--problems", "TSP_or:0", "hvac10", "--out", str(tmp_path)]
    assert bench.main(words) == 0
    assert capsys.readouterr().out.startswith("0 tasks")
    assert bench.main(["ablation", "--problems", "hvac99", "--out", str(tmp_path)]) == 2
    assert "has no problem 'hvac99'" in capsys.readouterr().err
