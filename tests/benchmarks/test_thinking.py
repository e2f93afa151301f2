"""Thinking beside the same policy alone: what is run, and what the table says of it."""

import json

import pytest

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.tasks.names import HIDDEN_TASKS
from benchmarks.tasks.thinking import run_thinking, thinking_table
from benchmarks.tasks.trial import KEYS, THINKING_COLUMNS, Conditions, Task
from mdpo_rddl.problem.load import load_problem


def add(records, problem, returns, alone=(), **others):
    row = {"status": "ok", "mean": sum(returns) / max(1, len(returns)), **others}
    row |= {"returns": json.dumps(returns), "alone": json.dumps(alone) if alone else ""}
    if alone:
        figures = {"decisions": 40, "left_base": 7, "p99_seconds": 0.18, "max_seconds": 0.1902}
        row |= {"method": "sequences", **figures}
    key = (problem, "1", "mdpo-thinking", others.get("seed", 0))
    columns = THINKING_COLUMNS[len(KEYS) :]
    records.add(*key, *(row.get(name, "") for name in columns))


def test_the_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "rows.csv", THINKING_COLUMNS, KEYS)
    add(records, "C", [1.0, 5.0], [3.0, 3.0])
    add(records, "A", [3.0, 5.0], [2.0, 4.0])
    add(records, "B", [1.0, 1.0, 9.0], [2.0, 2.0])
    add(records, "D", [7.0], note="no gain")
    add(records, "E", [], status="time limit")
    lines = thinking_table(records).splitlines()
    assert "| A | 1 | sequences | 4 | 3 | 1 [1, 1] | above | 40 | 7 | 0.180 | 0.190 |" in lines
    assert any(
        line.startswith("| B | 1 | sequences | 1 | 2 | -1 [-1, -1] | below") for line in lines
    )
    assert any(line.startswith("| C | 1 | sequences | 3 | 3 | 0 [") for line in lines)
    assert "| D | 1 | no gain | 7 |  |  |  |  |  |  |  |" in lines
    assert "| E | 1 | time limit | failed |  |  |  |  |  |  |  |" in lines
    said = "Thinking was chosen in 3 of 5 runs: above on 1, as good on 1, below on 1."
    assert lines[-1] == said
    assert [line.split(" | ")[0] for line in lines[2:7]] == ["| A", "| B", "| C", "| D", "| E"]


def test_only_the_tasks_of_a_shard_are_run(tmp_path, monkeypatch):
    asked = []

    def run(out, tasks, planners, seeds, conditions):
        asked.append((out, *tasks, *planners, seeds, conditions.decision_seconds))
        return Records(out / "rows.csv", THINKING_COLUMNS, KEYS)

    monkeypatch.setattr("benchmarks.tasks.thinking.run_tasks", run)
    tasks = [Task("A", "1"), Task("B", "1"), Task("C", "1")]
    run_thinking(tmp_path, tasks, 2, Conditions(60.0, 20, 8.0, 0.5), (1, 2))
    assert asked == [(tmp_path, tasks[1], "mdpo-thinking", 2, 0.5)]


def test_the_command_prints_the_table(tmp_path, monkeypatch, capsys):
    asked = []

    def run(out, tasks, planners, seeds, conditions):
        asked.append((len(tasks), conditions.seconds, conditions.decision_seconds))
        return Records(out / "rows.csv", THINKING_COLUMNS, KEYS)

    monkeypatch.setattr("benchmarks.tasks.thinking.run_tasks", run)
    assert bench.main(["thinking", "--out", str(tmp_path)]) == 0
    assert asked == [(16, 60.0, 0.2)]
    assert "Thinking was chosen in 0 of 0 runs" in capsys.readouterr().out


@pytest.mark.parametrize("task", HIDDEN_TASKS)
def test_by_default_the_state_is_not_observed(task):
    name, _, instance = task.partition(":")
    assert load_problem(name, instance).model.observ_fluents
