"""The competition of 2014: its returns, and a table worked by hand."""

import json

import numpy as np
import pytest

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.tasks.ippc2014 import competition, ippc2014_table, run_ippc2014
from benchmarks.tasks.published import published
from benchmarks.tasks.trial import COLUMNS, KEYS, THINKING_COLUMNS, Conditions

TABLE = """\
| problem | instance | ours | optimum | score | PROST | no-op | random |
|---|---|---|---|---|---|---|---|
| Traffic_MDP_ippc2014 | 2 | -20 |  | 0.751 | -11.7 | -100 | -45 |
| Traffic_MDP_ippc2014 | 4 | error |  | 0.000 | -42.23 | -200 | error |
| TriangleTireworld_MDP_ippc2014 | 10 | -40 | proven | 1.000 | -40 | -40 | -40 |

At 0.99 of PROST's return or above: 1 of 3. Mean score, each at most 1: 0.584. Below 0: 0.

Without the proven optima. At 0.99 of PROST's return or above: 0 of 2. \
Mean score, each at most 1: 0.375. Below 0: 0.
"""


def name_of(task):
    return task.problem.split("_")[0]


def test_its_instances_are_none_of_the_published_tasks():
    tasks = competition()
    assert len(tasks) == 40
    assert {task.instance for task in tasks} == {"2", "4", "6", "8", "10"}
    domains, others = ({name_of(task) for task in each} for each in (tasks, published()))
    # three of them were in the competition of 2011 too, by whose names the others are called
    assert len(domains & others) == len(domains) == 8
    labels = ({(name_of(task), task.instance) for task in each} for each in (tasks, published()))
    assert not set.intersection(*labels)


def test_the_table_compares_ours_with_the_winner(tmp_path):
    records = Records(tmp_path / "rows.csv", COLUMNS, KEYS)
    for problem, instance, returns in (
        ("Traffic_MDP_ippc2014", "2", {"mdpo": -20.0, "noop": -100.0, "random": -45.0}),
        ("Traffic_MDP_ippc2014", "4", {"mdpo": None, "noop": -200.0, "random": None}),
        ("TriangleTireworld_MDP_ippc2014", "10", dict.fromkeys(("mdpo", "noop", "random"), -40.0)),
        # without the floor there is no score yet
        ("Wildfire_MDP_ippc2014", "2", {"mdpo": -300.0}),
    ):
        for planner, mean in returns.items():
            found = {"status": "error"}
            if mean is not None:
                found = {"status": "ok", "mean": mean, "returns": json.dumps([mean])}
            if planner == "mdpo" and instance == "10":
                found["arms"] = "dynamic programming"
            figures = (found.get(name, "") for name in COLUMNS[len(KEYS) :])
            records.add(problem, instance, planner, 0, *figures)
    assert ippc2014_table(records) == TABLE


def test_the_table_says_where_thinking_has_paid(tmp_path):
    records = Records(tmp_path / "rows.csv", THINKING_COLUMNS, KEYS)
    for planner, returns in {
        "mdpo-thinking": [-12.0, -11.0],
        "noop": [-57.0],
        "random": [-52.0],
    }.items():
        found = {"status": "ok", "mean": np.mean(returns), "returns": json.dumps(returns)}
        if planner == "mdpo-thinking":
            found |= {"decision_seconds": 0.2, "method": "sequences", "alone": "[-14.0, -13.0]"}
        figures = (found.get(name, "") for name in THINKING_COLUMNS[len(KEYS) :])
        records.add("Traffic_MDP_ippc2014", "2", planner, 0, *figures)
    *_, row, _, totals, _, said = ippc2014_table(records).splitlines()
    assert row == "| Traffic_MDP_ippc2014 | 2 | -11.5 |  | 1.005 | -11.7 | -57 | -52 |"
    assert totals.startswith("At 0.99 of PROST's return or above: 1 of 1.")
    assert said == (
        "Ours with 0.2 s a decision, used on 1 task. Against the same policy alone in the same "
        "episodes: better on 1, as good on 0, worse on 0."
    )


def test_a_run_asks_for_ours_and_the_floor(tmp_path, monkeypatch, capsys):
    asked = []

    def run(out, tasks, planners, seeds, conditions):
        asked.append((tasks, tuple(planners)))
        return Records(out / "rows.csv", COLUMNS, KEYS)

    monkeypatch.setattr("benchmarks.tasks.ippc2014.run_tasks", run)
    run_ippc2014(tmp_path, ["Traffic_MDP_ippc2014"], 1, Conditions(1.0, 1, 4.0), (1, 2))
    assert [([task.instance for task in tasks], planners) for tasks, planners in asked] == [
        (["4", "8"], ("mdpo", "noop", "random"))
    ]
    run_ippc2014(tmp_path, ["Traffic_MDP_ippc2014:2"], 1, Conditions(1.0, 1, 4.0, 0.2))
    assert asked[1][1] == ("mdpo-thinking", "noop", "random")
    words = ["ippc2014", "--problems", "Traffic_MDP_ippc2014:3", "--out", str(tmp_path)]
    assert bench.main(words) == 2
    assert "there are no published returns of 'Traffic_MDP_ippc2014:3'" in capsys.readouterr().err


@pytest.mark.parametrize("problems", [None, ["Wildfire_MDP_ippc2014:8"]])
def test_nothing_measured_is_an_empty_table(tmp_path, problems, monkeypatch, capsys):
    monkeypatch.setattr(
        "benchmarks.tasks.ippc2014.run_tasks",
        lambda out, *_: Records(out / "rows.csv", COLUMNS, KEYS),
    )
    words = [] if problems is None else ["--problems", *problems]
    assert bench.main(["ippc2014", "--out", str(tmp_path), *words]) == 0
    assert "No task has been played." in capsys.readouterr().out
