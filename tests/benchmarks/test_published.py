"""Tests of the tasks with published returns, and of the episodes that these are of."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.mistakes import one_line
from helpers.task_rows import records_of, row_of

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.tasks.published import (
    published,
    read_published,
    run_published,
    score,
    score_in_equal_steps,
)
from benchmarks.tasks.published_episodes import ShorterReturns, published_seeds
from benchmarks.tasks.published_figure import OURS, published_scores
from benchmarks.tasks.published_table import published_table
from benchmarks.tasks.trial import COLUMNS, KEYS, SHORTER, Conditions, Task, run_tasks
from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment

QUICK = Conditions(seconds=1.0, episodes=3, memory_gb=4.0)
BELOW = "Below 0.99 with all of the 95% interval of its episodes: "


def test_ours_plays_all_of_the_published_episodes(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(
        "benchmarks.tasks.published.run_tasks", lambda *given: asked.append(given[-1])
    )
    run_published(tmp_path, ["Navigation_MDP_ippc2011"], 1, replace(QUICK, decision_seconds=0.5))
    assert asked == [replace(QUICK, decision_seconds=0.5, as_published=True)]


@pytest.mark.parametrize("command", ["published", "ippc2014"])
def test_thinking_has_a_folder_of_its_own(command, monkeypatch):
    asked = []

    def run(out, problems, seeds, conditions, shard):
        asked.append((out, conditions.decision_seconds))
        raise InputError("enough")

    monkeypatch.setattr(f"benchmarks.commands.tasks.run_{command}", run)
    for words in ([], ["--decision-seconds", "0.2"], ["--decision-seconds", "1", "--out", "x"]):
        assert bench.main([command, *words]) == 2
    folders = [Path("results") / command, Path("results") / f"{command}_thinking", Path("x")]
    assert asked == list(zip(folders, [0.0, 0.2, 1.0], strict=True))


def test_scores_worked_by_hand():
    row = {"noop": "-40", "random": "-30", "best": "-10"}
    assert score(-30.0, row) == 0.0
    assert score(-10.0, row) == 1.0
    assert score(-5.0, row) == 1.25
    assert score(-40.0, row) == -0.5
    reached = {"noop": "0", "random": "-101.4", "best": "0"}
    assert score(0.0, reached) == 1.0
    assert score(3.0, reached) == 1.0
    assert score(-1.0, reached) == 0.0


def test_prosts_returns_are_compared_with_those_before_the_last_step():
    row = dict.fromkeys(next(iter(published().values())), "")
    row |= {"noop": "-40", "random": "-50", "prost_1": "-12", "prost_3": "-10", "jaxplan_1": "-20"}
    assert score_in_equal_steps(-10.0, -9.0, row) == 31.0 / 30.0
    assert score_in_equal_steps(-11.0, -10.0, row) == 1.0
    # what PROST returned in the competition is of all steps
    assert score_in_equal_steps(-10.0, -9.0, row | {"prost_ippc2014": "0"}) == 0.75
    assert score_in_equal_steps(-30.0, -9.0, row) == 0.5  # behind JaxPlan in all steps
    assert score_in_equal_steps(-10.0, 0.0, row | {"prost_1": "", "prost_3": ""}) == 1.5


def test_the_published_seeds_are_the_numbers_of_fibonacci():
    assert published_seeds(8) == [1, 2, 3, 5, 8, 13, 21, 34]
    assert published_seeds(50)[:8] == published_seeds(8)
    assert published_seeds(46)[-2:] == [1836311903, 823731426]  # 2,971,215,073 is too large


@pytest.mark.parametrize(
    ("problem", "instance"),
    [("Traffic_MDP_ippc2014", "7"), ("Elevators_MDP_ippc2011", "1"), ("Reservoir_ippc2023", "3")],
)
def test_the_no_op_returns_what_was_published(problem, instance):
    env = make_environment(load_problem(problem, instance))
    played = evaluate(env, lambda step, state: {}, 20, published_seeds(20))
    noop = float(published()[Task(problem, instance)]["noop"])  # of six digits
    assert played.mean == pytest.approx(noop, rel=1e-5)


def test_what_is_returned_before_the_last_step():
    shorter = ShorterReturns(horizon=3, discount=0.5)
    for rewards in ([4.0, 2.0, 8.0], [1.0]):
        episode = shorter.begin()
        for reward in rewards:
            episode.add({}, {}, reward)
    assert shorter.returns == [5.0, 1.0]


@pytest.mark.long
def test_a_trial_keeps_what_was_returned_before_the_last_step(tmp_path):
    conditions = replace(QUICK, as_published=True)
    tasks = [Task("Navigation_MDP_ippc2011", "1")]
    (row,) = run_tasks(tmp_path, tasks, ["noop"], 1, conditions).rows
    assert json.loads(row["returns"]) == [-40.0] * 3
    assert json.loads(row[SHORTER]) == [-39.0] * 3
    assert read_published(tmp_path / "rows.csv").rows == [row]


def test_the_published_tasks():
    rows = published()
    assert len(rows) == 81
    for task, row in rows.items():
        others = [row[name] for name in row if name.endswith(("_1", "_3", "_5", "_ippc2014"))]
        assert float(row["best"]) == max(float(value) for value in others if value), task


def test_published_rows_are_read_from_regular_files_of_a_bounded_size(tmp_path, monkeypatch):
    pipe, large = tmp_path / "pipe", tmp_path / "large.csv"
    os.mkfifo(pipe)
    assert one_line(lambda: read_published(pipe)) == f"{pipe}: is not a regular file"
    zero = Path("/dev/zero")
    assert one_line(lambda: read_published(zero)) == "/dev/zero: is not a regular file"
    large.write_bytes(b"x" * 1001)
    monkeypatch.setattr("benchmarks.tasks.published.MOST_BYTES", 1000)
    assert "large.csv: is larger than 1,000 bytes" in one_line(lambda: read_published(large))


def test_the_published_table_counts_what_reaches_the_best(tmp_path):
    best = float(published()[Task("Navigation_MDP_ippc2011", "1")]["best"])
    records = records_of(tmp_path, ("Navigation_MDP_ippc2011", "mdpo", [best, best]))
    records.add("SysAdmin_MDP_ippc2011", "1", "mdpo", 0, *row_of(status="memory", cause="over"))
    table = published_table(records)
    assert "| Navigation_MDP_ippc2011 | 1 | -8 | 1.000 | -8 | prost_1 |" in table
    assert "| SysAdmin_MDP_ippc2011 | 1 | memory | 0.000 |" in table
    assert table.endswith(
        "or above: 1 of 2. Mean score, each at most 1: 0.500. Below 0: 0. " + BELOW + "1.\n"
    )


def test_the_published_table_says_where_the_episodes_tell_that_ours_is_below(tmp_path):
    row = published()[Task("Navigation_MDP_ippc2011", "1")]
    assert float(row["best"]) == -8.0
    for returns, expected in (([-9.0, -9.5, -9.0], 1), ([-4.0, -14.0, -9.0], 0)):
        folder = tmp_path / str(expected)
        records = records_of(folder, ("Navigation_MDP_ippc2011", "mdpo", returns))
        assert published_table(records).endswith(
            "or above: 0 of 1. Mean score, each at most 1: "
            f"{score(sum(returns) / 3, row):.3f}. Below 0: 0. {BELOW}{expected}.\n"
        )


def test_the_table_has_scores_in_equal_steps(tmp_path):
    columns = (*COLUMNS, SHORTER)
    records = Records(tmp_path / "rows.csv", columns, KEYS)
    prost = published()[Task("Traffic_MDP_ippc2014", "7")]
    ours = float(prost["prost_3"]) - 1.0
    for instance, shorter in (("7", ours + 1.0), ("9", -98.1)):
        figures = {"mean": ours, "returns": f"[{ours}]", SHORTER: f"[{shorter}]"}
        records.add("Traffic_MDP_ippc2014", instance, "mdpo", 0, *row_of(columns, **figures))
    failure = row_of(columns, status="memory", cause="over")
    records.add("SysAdmin_MDP_ippc2011", "1", "mdpo", 0, *failure)
    table = published_table(records)
    scored = f"| {ours:g} | {score(ours, prost):.3f} | {ours + 1.0:g} | 1.000 | -39 | prost_3 |"
    assert f"| Traffic_MDP_ippc2014 | 7 {scored}" in table
    assert "| SysAdmin_MDP_ippc2011 | 1 | memory | 0.000 |  | 0.000 |" in table
    assert (
        "The same in equal steps: At 0.99 of the best published return or above: 1 of 3. " in table
    )
    assert table.endswith(
        "Mean below PROST's with 1 s: on 2 of 2 domains: SysAdmin_MDP_ippc2011 (failed, PROST "
        "335.9), Traffic_MDP_ippc2014 (-40, PROST -27.62); before the last step on 2 of 2 domains: "
        "SysAdmin_MDP_ippc2011 (failed, PROST 335.9), "
        "Traffic_MDP_ippc2014 (-68.55, PROST -27.62).\n"
    )


def test_the_picture_has_the_best_of_the_others_times(tmp_path):
    task = Task("SysAdmin_MDP_ippc2011", "1")
    row = published()[task]
    best = float(row["best"])
    records = records_of(tmp_path, (task.problem, "mdpo", [best, best]))
    found = published_scores(records)
    assert list(found) == [task]
    assert found[task][OURS] == 1.0
    prost = max(float(row[f"prost_{seconds}"]) for seconds in (1, 3, 5))
    assert found[task]["PROST"] == score(prost, row)
    assert "DiSProD" not in found[task]


def test_the_report_is_made_of_the_rows_alone(tmp_path, capsys):
    arguments = ["published-report", "--out", str(tmp_path)]
    assert bench.main(arguments) == 2
    assert "rows.csv: no such results" in capsys.readouterr().err
    records = records_of(tmp_path, ("Navigation_MDP_ippc2011", "mdpo", [-8.0, -8.0]))
    rows = records.path.read_bytes()
    assert bench.main(arguments) == 0
    assert capsys.readouterr().out == published_table(records)
    assert (tmp_path / "published.png").stat().st_size > 10_000
    assert records.path.read_bytes() == rows
