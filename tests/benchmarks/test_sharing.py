"""Time at the decisions or before them: what is run, and what the table says of it."""

import json

import pytest

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.tasks.sharing import read_sharing, run_sharing, sharing_table
from benchmarks.tasks.trial import COLUMNS, KEYS, THINKING_COLUMNS, Conditions, Task
from mdpo_rddl.errors import InputError

QUICK = Conditions(seconds=30.0, episodes=3, memory_gb=4.0, decision_seconds=0.5)


def add(out, columns, task, planner, returns, **others):
    records = Records(out / "rows.csv", columns, KEYS)
    mean = sum(returns) / max(1, len(returns))
    row = {"status": "ok" if returns else "error", "mean": mean, "returns": json.dumps(returns)}
    key = (task.problem, task.instance, planner, others.pop("seed", 0))
    records.add(*key, *({**row, **others}.get(name, "") for name in columns[len(KEYS) :]))
    return records


def test_where_thinking_was_chosen_the_preparation_gets_its_time(tmp_path, monkeypatch):
    asked = []

    def run(out, tasks, planners, seeds, conditions):
        (task,), (planner,) = tasks, planners
        asked.append((out.name, task.problem, planner, conditions.seconds))
        if planner == "mdpo":
            return add(out, COLUMNS, task, planner, [0.0, 1.0, 2.0])
        method = "residuals" if task.problem == "Gains" else ""
        return add(out, THINKING_COLUMNS, task, planner, [1.0] * 3, method=method, horizon=20)

    monkeypatch.setattr("benchmarks.tasks.sharing.run_tasks", run)
    tasks = [Task("Gains", "1"), Task("None", "1")]
    run_sharing(tmp_path, tasks, 1, QUICK)
    assert asked == [
        ("thinking", "Gains", "mdpo-thinking", 30.0),
        ("60", "Gains", "mdpo", 60.0),  # 3 episodes of 20 decisions of 0.5 s
        ("thinking", "None", "mdpo-thinking", 30.0),
    ]
    found = read_sharing(tmp_path)
    assert found[Task("Gains", "1")].seconds == 60.0
    assert not found[Task("None", "1")].alone
    asked.clear()
    run_sharing(tmp_path / "second", tasks, 1, QUICK, (1, 2))
    assert {problem for _, problem, *_ in asked} == {"None"}
    asked.clear()
    run_sharing(tmp_path / "third", tasks, 1, QUICK, decided=1)
    assert asked[1] == ("40", "Gains", "mdpo", 40.0)
    asked.clear()
    run_sharing(tmp_path / "fourth", tasks, 1, QUICK, decided=0)
    assert asked[1] == ("30", "Gains", "mdpo", 30.0)


def test_another_preparation_is_refused_before_it_is_played(tmp_path, monkeypatch):
    task = Task("Gains", "1")
    add(tmp_path / "thinking", THINKING_COLUMNS, task, "mdpo-thinking", [1.0], method="sequences")
    add(tmp_path / "38", COLUMNS, task, "mdpo", [1.0])
    monkeypatch.setattr("benchmarks.tasks.sharing._decisions", lambda *_: 20)

    def run(out, *_):
        assert out.name == "thinking"
        return Records(out / "rows.csv", THINKING_COLUMNS, KEYS)

    monkeypatch.setattr("benchmarks.tasks.sharing.run_tasks", run)
    with pytest.raises(InputError, match=r"Gains 1 has rows of 38 s; use another folder$"):
        run_sharing(tmp_path, [task], 1, QUICK)


def test_a_folder_has_one_other_preparation_of_a_task(tmp_path):
    for seconds, task in (("38", "A"), ("110", "A"), ("54", "B")):
        add(tmp_path / seconds, COLUMNS, Task(task, "1"), "mdpo", [1.0])
    with pytest.raises(InputError, match=r"38/rows\.csv: A 1 has rows of 110 s as well$"):
        read_sharing(tmp_path)


def test_the_table_worked_by_hand(tmp_path):
    thinking, alone = tmp_path / "thinking", tmp_path / "70"
    toy, lost, level, plain, failed = (Task(name, "1") for name in "ABCDE")
    for task, returns in ((toy, [3.0, 5.0]), (lost, [1.0, 1.0]), (level, [0.0, 4.0])):
        add(thinking, THINKING_COLUMNS, task, "mdpo-thinking", returns, method="sequences")
        add(alone, COLUMNS, task, "mdpo", [2.0, 4.0] if task != level else [2.0, 2.0])
    # one more seed, in which the policy played alone, and more episodes
    other = {"seed": 1, "note": "no gain"}
    add(thinking, THINKING_COLUMNS, toy, "mdpo-thinking", [5.0, 7.0, 99.0], **other)
    add(alone, COLUMNS, toy, "mdpo", [4.0, 6.0], seed=1)
    add(thinking, THINKING_COLUMNS, plain, "mdpo-thinking", [7.0], note="no gain")
    add(thinking, THINKING_COLUMNS, failed, "mdpo-thinking", [])
    table = sharing_table(read_sharing(tmp_path))
    assert "| A | 1 | sequences | 5 | 4 | 70 | 1 [1, 1] | better |" in table
    assert "| B | 1 | sequences | 1 | 3 | 70 | -2 [" in table
    assert "| C | 1 | sequences | 2 | 2 | 70 | 0 [" in table
    assert "| D | 1 | no gain | 7 |  |  |  |  |" in table
    assert "| E | 1 | error | failed |  |  |  |  |" in table
    assert table.endswith("3 of 5 tasks: better on 1, as good on 2, worse on 0.\n")


def test_a_foreign_folder_is_refused(tmp_path):
    add(tmp_path / "later", COLUMNS, Task("Toy", "1"), "mdpo", [1.0])
    with pytest.raises(InputError, match="not named by a time in seconds"):
        read_sharing(tmp_path)


def test_the_command_prints_the_table(tmp_path, monkeypatch, capsys):
    asked = []

    def run(out, tasks, planners, seeds, conditions):
        asked.append((conditions.seconds, conditions.decision_seconds, conditions.episodes))
        return Records(out / "rows.csv", THINKING_COLUMNS, KEYS)

    monkeypatch.setattr("benchmarks.tasks.sharing.run_tasks", run)
    assert bench.main(["sharing", "--problems", "TSP_or:0", "--out", str(tmp_path)]) == 0
    assert asked == [(30.0, 0.2, 10)]
    assert "Thinking was chosen on 0 of 0 tasks" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        bench.main(["sharing", "--decided", "-1", "--out", str(tmp_path)])
    assert "--decided" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        bench.main(["sharing", "--decision-seconds", "0", "--out", str(tmp_path)])
    assert "must be a number above 0" in capsys.readouterr().err
