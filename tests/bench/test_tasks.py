"""Planners on many tasks: the rows of real trials, the scores and tables worked by hand."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.clocks import Stopped
from helpers.levers import NONE, lever_policy
from helpers.mistakes import one_line
from helpers.slow_simulator import SlowSimulator

from mdpo_rddl.bench.common.records import Records
from mdpo_rddl.bench.tasks import everywhere, trial
from mdpo_rddl.bench.tasks.everywhere import everywhere_table, run_everywhere
from mdpo_rddl.bench.tasks.everywhere_figure import shares_of
from mdpo_rddl.bench.tasks.published import (
    published,
    published_table,
    read_published,
    run_published,
    score,
)
from mdpo_rddl.bench.tasks.published_figure import OURS, published_scores
from mdpo_rddl.bench.tasks.trial import COLUMNS, KEYS, Conditions, Task, run_tasks
from mdpo_rddl.cli import bench
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.thinking import ThinkingMDPO
from mdpo_rddl.policy.lookahead.choice import Choice
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE
from mdpo_rddl.problem.repository import named_instance

QUICK = Conditions(seconds=1.0, episodes=3, memory_gb=4.0)


def row_of(**values):
    return tuple({"status": "ok", **values}.get(name, "") for name in COLUMNS[len(KEYS) :])


def records_of(path, *rows):
    records = Records(path / "rows.csv", COLUMNS, KEYS)
    for problem, planner, returns in rows:
        mean = sum(returns) / len(returns)
        figures = row_of(mean=mean, returns=json.dumps(returns))
        records.add(problem, "1", planner, 0, *figures)
    return records


@pytest.mark.long
def test_trials_are_recorded_and_not_repeated(tmp_path, monkeypatch):
    tasks = [Task("SysAdmin_MDP_ippc2011", "1")]
    records = run_tasks(tmp_path, tasks, ["noop", "random"], 1, QUICK)
    noop, random = records.rows
    assert (noop["status"], random["status"], noop["horizon"]) == ("ok", "ok", "40")
    returns = json.loads(noop["returns"])
    assert len(returns) == 3
    assert float(noop["mean"]) == pytest.approx(sum(returns) / 3)
    assert json.loads(random["returns"]) != returns
    monkeypatch.setattr("mdpo_rddl.bench.tasks.trial.run_guarded", None)  # nothing is run again
    assert run_tasks(tmp_path, tasks, ["noop", "random"], 1, QUICK).rows == records.rows


def test_a_planner_that_fails_has_a_row_that_says_so(tmp_path):
    planners = ["helpers.toy_contest:Raising"]
    (row,) = run_tasks(tmp_path, [Task("Elevators", "0")], planners, 1, QUICK).rows
    assert row["status"] == "error"
    assert row["cause"]
    assert row["mean"] == ""


@pytest.fixture
def thinking_on_levers(monkeypatch):
    """On the toy with three arms, in this process, with the method as if trials had chosen it."""
    policy, clock = lever_policy(NONE), Stopped()
    simulator = SlowSimulator(policy, clock, {WIDE: 0.01, NARROW: 0.01})
    method = FirstActions()
    method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 0.5, 0, clock)
    monkeypatch.setattr("mdpo_rddl.ipc.thinking.choose", lambda *_: Choice(thinker, [], "", 0.0))
    monkeypatch.setattr(ThinkingMDPO, "_find", lambda *_: policy)
    monkeypatch.setattr(trial, "load_problem", lambda *_: policy.problem)
    monkeypatch.setattr(trial, "run_guarded", lambda work, items, _: [(i, work(i)) for i in items])


@pytest.mark.usefixtures("thinking_on_levers")
def test_rows_of_thinking_say_how_decisions_were_made(tmp_path, capsys):
    tasks = [Task("Navigation_MDP_ippc2011", "1")]
    conditions = replace(QUICK, seconds=600.0, decision_seconds=0.5)
    (row,) = run_tasks(tmp_path, tasks, ["mdpo-thinking"], 1, conditions).rows
    assert (row["status"], row["decision_seconds"], row["method"]) == ("ok", "0.5", "first actions")
    assert (float(row["decisions"]), float(row["within_budget"])) == (3 * 4, 1.0)
    assert row["note"] == ""
    # the third arm pays 3, and no decision takes an arm for nothing
    assert float(row["mean"]) > 0.0
    assert 0.0 < float(row["p99_seconds"]) <= float(row["max_seconds"]) <= 0.5
    assert conditions.limits.seconds > replace(conditions, decision_seconds=0.0).limits.seconds
    # the report reads them, and rows without thinking are others
    assert bench.main(["published-report", "--out", str(tmp_path)]) == 0
    table = capsys.readouterr().out
    assert "| Navigation_MDP_ippc2011 | 1 |" in table
    assert "Ours with 0.5 s a decision, used on 1 tasks. Against the same policy alone" in table
    assert table.endswith("in the same episodes: better on 1, as good on 0, worse on 0.\n")
    assert max(json.loads(row["alone"])) < min(json.loads(row["returns"]))
    with pytest.raises(InputError, match="holds other results"):
        run_tasks(tmp_path, tasks, ["mdpo"], 1, QUICK)


@pytest.mark.usefixtures("thinking_on_levers")
def test_thinking_plays_as_many_episodes_as_its_time_allows_or_all(tmp_path, monkeypatch):
    monkeypatch.setattr(trial, "_USUAL_STEPS", 2)
    monkeypatch.setattr(trial, "_FEWEST_EPISODES", 1)
    thinking = replace(QUICK, seconds=600.0, decision_seconds=0.5)
    tasks = [Task("Navigation_MDP_ippc2011", "1")]
    whole = replace(thinking, plays_all=True)
    counts = []
    for number, conditions in enumerate((thinking, whole)):
        (row,) = run_tasks(tmp_path / str(number), tasks, ["mdpo-thinking"], 1, conditions).rows
        counts.append(len(json.loads(row["returns"])))
    assert counts == [1, QUICK.episodes]
    with pytest.raises(InputError, match="made with another plays_all"):
        run_tasks(tmp_path / "0", tasks, ["mdpo-thinking"], 1, whole)


def test_published_means_are_compared_with_those_of_all_episodes(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(
        "mdpo_rddl.bench.tasks.published.run_tasks", lambda *given: asked.append(given[-1])
    )
    run_published(tmp_path, ["Navigation_MDP_ippc2011"], 1, replace(QUICK, decision_seconds=0.5))
    assert asked == [replace(QUICK, decision_seconds=0.5, plays_all=True)]


def test_thinking_has_a_folder_of_its_own(monkeypatch, tmp_path):
    asked = []

    def run(out, problems, seeds, conditions, shard):
        asked.append((out, conditions.decision_seconds))
        raise InputError("enough")

    monkeypatch.setattr("mdpo_rddl.cli.bench_tasks.run_published", run)
    for words in ([], ["--decision-seconds", "0.2"], ["--decision-seconds", "1", "--out", "x"]):
        assert bench.main(["published", *words]) == 2
    folders = [Path("results/published"), Path("results/published_thinking"), Path("x")]
    assert asked == list(zip(folders, [0.0, 0.2, 1.0], strict=True))


def test_unknown_names_are_told_before_anything_is_run(tmp_path):
    with pytest.raises(InputError, match="rddlrepository has no problem 'Nowhere'"):
        run_everywhere(tmp_path, ["Nowhere"], ["noop"], 1, QUICK)
    with pytest.raises(InputError, match="rddlrepository has no instance '7' of Elevators"):
        run_everywhere(tmp_path, ["Elevators:7"], ["noop"], 1, QUICK)
    with pytest.raises(InputError, match="unknown planner 'nobody'"):
        run_tasks(tmp_path, [Task("Elevators", "0")], ["nobody"], 1, QUICK)
    assert list(tmp_path.iterdir()) == []


def test_ours_is_below_where_the_paired_interval_is(tmp_path):
    noisy = [0.0, 100.0, -100.0, 50.0]
    records = records_of(
        tmp_path,
        ("Below", "mdpo", noisy),
        ("Below", "noop", [value + 1.0 for value in noisy]),  # by 1 on every episode
        ("Level", "mdpo", [1.0, 2.0, 3.0]),
        ("Level", "random", [2.0, 1.0, 3.1]),
        ("Above", "mdpo", [1.0, 1.0]),
        ("Above", "jaxplan-slp", [0.0, 0.0]),
    )
    lines = everywhere_table(records).splitlines()
    assert lines[0].startswith("| problem | instance | mdpo | jaxplan-slp |")
    assert lines[2] == "| Above | 1 | 1 | 0 |  |  |  |  |"
    assert lines[3] == "| Below | 1 | 12.5 |  |  | 13.5 |  | noop |"
    assert lines[4] == "| Level | 1 | 2 |  |  |  | 2.03333 |  |"
    assert lines[-1] == "Below another planner: 1 of 3 problems."


@pytest.mark.long
def test_a_row_of_ours_names_the_arm_that_found_the_policy(tmp_path):
    conditions = replace(QUICK, seconds=10.0)
    tasks = [Task("Navigation_MDP_ippc2011", "1")]
    ours, noop = run_tasks(tmp_path, tasks, ["mdpo", "noop"], 1, conditions).rows
    assert (ours["status"], ours["arms"], noop["arms"]) == ("ok", "dynamic programming", "")


def test_the_table_counts_the_arms_that_found_the_policies(tmp_path):
    records = records_of(tmp_path, ("Other", "noop", [1.0]))
    for problem, arms in (("A", "plan; polishing"), ("B", "polishing"), ("C", "constants; ppo")):
        records.add(problem, "1", "mdpo", 0, *row_of(mean=1.0, returns="[1.0]", arms=arms))
    table = everywhere_table(records)
    assert table.endswith(" problems.\n\nOurs were found by: polishing 2, ppo 1.\n")


def test_the_picture_places_planners_between_the_worst_and_the_best(tmp_path):
    records = records_of(
        tmp_path,
        ("Two", "mdpo", [3.0, 3.0]),
        ("Two", "noop", [1.0, 1.0]),
        ("Two", "random", [1.0, 2.0]),
        ("Same", "mdpo", [0.0]),
        ("Same", "noop", [0.0]),
        ("Alone", "mdpo", [1.0]),
    )
    records.add("Same", "2", "mdpo", 0, *row_of(mean=2.0))
    records.add("Same", "2", "noop", 0, *row_of(mean=1.0))
    records.add("Two", "1", "jaxplan-slp", 0, *row_of(status="timeout", cause="over 1 s"))
    assert shares_of(records) == {
        "Two": {"mdpo": 1.0, "noop": 0.0, "random": 0.25},
        "Same 1": {"mdpo": 1.0, "noop": 1.0},
        "Same 2": {"mdpo": 1.0, "noop": 0.0},
    }


def test_a_failure_of_ours_is_below_whoever_has_returns(tmp_path):
    records = records_of(tmp_path, ("P", "noop", [0.0, 0.0]))
    records.add("P", "1", "mdpo", 0, *row_of(status="timeout", cause="over 1 s"))
    assert "| timeout |" in everywhere_table(records)
    assert everywhere_table(records).endswith("Below another planner: 1 of 1 problems.\n")


@pytest.mark.long
def test_jobs_share_the_problems(tmp_path):
    names = ["Navigation_MDP_ippc2011", "SysAdmin_MDP_ippc2011", "TSP_or"]
    run_everywhere(tmp_path, names, ["noop"], 1, QUICK, (1, 2))
    records = run_everywhere(tmp_path, names, ["noop"], 1, QUICK, (0, 2))
    assert [row["problem"] for row in records.rows] == [names[1], names[0], names[2]]


def test_the_first_instance_is_rddlrepositorys():
    assert named_instance("UAV_ippc2023") == ("UAV_ippc2023", "1")
    assert named_instance("UAV_ippc2023:5") == ("UAV_ippc2023", "5")
    assert len(everywhere.domains()) == 90


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
    monkeypatch.setattr("mdpo_rddl.bench.tasks.published.MOST_BYTES", 1000)
    assert "large.csv: is larger than 1,000 bytes" in one_line(lambda: read_published(large))


BELOW = "Below 0.99 with all of the 95% interval of its episodes: "


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


def test_the_commands(tmp_path, capsys):
    arguments = ["--seconds", "1", "--episodes", "2", "--out", str(tmp_path)]
    problems = ["--problems", "Navigation_MDP_ippc2011"]
    assert bench.main(["everywhere", *arguments, *problems, "--planners", "noop"]) == 0
    assert "| Navigation_MDP_ippc2011 | 1 |" in capsys.readouterr().out
    assert (tmp_path / "table.md").is_file()
    assert (tmp_path / "everywhere.png").is_file()
    assert bench.main(["published", *arguments, "--problems", "Nowhere"]) == 2
    assert "there are no published returns of 'Nowhere'" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        bench.main(["published", *arguments, "--shard", "2/2"])
    assert ended.value.code == 2
    assert "--shard: must be I/N with 0 <= I < N" in capsys.readouterr().err


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
