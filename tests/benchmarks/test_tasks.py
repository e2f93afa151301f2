"""Planners on many tasks: the rows of real trials, the scores and tables worked by hand."""

import json
from dataclasses import replace

import pytest
from helpers.clocks import Stopped
from helpers.levers import NONE, lever_policy
from helpers.slow_simulator import SlowSimulator
from helpers.task_rows import records_of, row_of

from benchmarks import main as bench
from benchmarks.tasks import everywhere, trial
from benchmarks.tasks.everywhere import everywhere_table, run_everywhere
from benchmarks.tasks.everywhere_figure import shares_of
from benchmarks.tasks.trial import Conditions, Task, run_tasks
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.thinking import ThinkingMDPO
from mdpo_rddl.policy.lookahead.choice import Choice
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE
from mdpo_rddl.problem.repository import named_instance

QUICK = Conditions(seconds=1.0, episodes=3, memory_gb=4.0)


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
    monkeypatch.setattr("benchmarks.tasks.trial.run_guarded", None)  # nothing is run again
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
    assert "Ours with 0.5 s a decision, used on 1 task. Against the same policy alone" in table
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
    whole = replace(thinking, as_published=True)
    counts = []
    for number, conditions in enumerate((thinking, whole)):
        (row,) = run_tasks(tmp_path / str(number), tasks, ["mdpo-thinking"], 1, conditions).rows
        counts.append(len(json.loads(row["returns"])))
    assert counts == [1, QUICK.episodes]
    with pytest.raises(InputError, match="holds other results"):
        run_tasks(tmp_path / "0", tasks, ["mdpo-thinking"], 1, whole)


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
