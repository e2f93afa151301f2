"""Random policies up to the edges of the numbers: what they play is legal, or counted."""

import numpy as np
import pytest
from helpers.toys import problem_from
from helpers.workers import in_this_process

from benchmarks.problems import each
from benchmarks.problems.inspection import Inspector
from benchmarks.problems.legal_play import legal_play_table, play, run_legal_play
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.problem.episode import Verdict
from mdpo_rddl.problem.load import make_environment

DOMAIN = """
domain edges {
    requirements = { reward-deterministic };
    types { place : object; colour : { @red, @blue }; };
    pvariables {
        s : { state-fluent, real, default = 0.0 };
        go(place) : { action-fluent, bool, default = false };
        paint : { action-fluent, colour, default = @red };
        many : { action-fluent, int, default = 0 };
        third : { action-fluent, real, default = 0.2 };
        free : { action-fluent, real, default = 0.0 };
    };
    cpfs { s' = third; };
    reward = s;
    action-preconditions {
        many >= -2147483648; many <= 9007199254740993;
        third >= 0.1; third <= 0.30000000000000004;
        (sum_{?p : place} [go(?p)]) <= 2;
    };
}
non-fluents nf { domain = edges; objects { place : {a, b, c}; }; }
instance one {
    domain = edges; non-fluents = nf; max-nondef-actions = 4; horizon = 3; discount = 1.0;
}
"""


@pytest.fixture(scope="module")
def problem():
    return problem_from(DOMAIN)


def action(**changes):
    return {
        "go": np.array([True, False, False]),
        "paint": np.array(0),
        "many": np.array(3),
        "third": np.array(0.25),
        "free": np.array(0.0),
    } | {name: np.asarray(value) for name, value in changes.items()}


@pytest.mark.parametrize(
    ("changes", "broken"),
    [
        ({}, set()),
        ({"free": 1e308}, set()),
        ({"many": -(2**31)}, set()),
        ({"many": np.int64(2**53 + 1)}, set()),
        ({"many": np.int64(2**53 + 2)}, {"box", "precondition"}),
        ({"many": np.int64(-(2**63))}, {"box", "precondition"}),
        ({"third": np.nextafter(0.1, 0.0)}, {"box", "precondition"}),
        ({"third": np.nextafter(0.30000000000000004, 1.0)}, {"box", "precondition"}),
        ({"third": np.float32(0.1)}, set()),
        # the environment itself compares with the rounded bound
        ({"third": np.float32(0.3)}, {"box"}),
        ({"go": [True, True, True]}, {"count", "precondition"}),
        ({"go": [True, True, False], "free": 1.0}, {"count"}),
        ({"free": np.inf}, {"type"}),
        ({"free": np.nan}, {"type"}),
        ({"many": 1.5}, {"type"}),
        ({"go": [1, 0, 0]}, {"type"}),
        ({"go": [True, False]}, {"type"}),
        ({"fly": True}, {"type"}),
        ({"paint": 1}, set()),
        ({"paint": "blue"}, set()),
        ({"paint": 2}, {"type"}),
        ({"paint": "green"}, {"type"}),
        ({"paint": 0.0}, {"type"}),
    ],
)
def test_what_an_action_breaks(problem, changes, broken):
    env = make_environment(problem)
    env.reset(seed=0)
    assert Inspector(env).broken(action(**changes)) == broken


def test_what_is_sent_and_not_refused_is_unsaid(problem, monkeypatch):
    env = make_environment(problem)
    env.reset(seed=0)
    inspector = Inspector(env)
    inspector.rule(action(free=np.nan))
    inspector.rule(action(third=5.0))
    assert inspector.counts["refused"] == inspector.counts["replaced"] == 1
    assert inspector.counts["unsaid"] == 0
    monkeypatch.setattr(
        inspector._referee, "rule", lambda given: Verdict(dict(given), illegal=False)
    )
    inspector.rule(action(free=np.nan))
    assert inspector.counts["type"] == inspector.counts["unsaid"] == 1
    monkeypatch.setattr(
        inspector._referee, "rule", lambda given: Verdict(dict(given), illegal=True)
    )
    inspector.rule(action(third=5.0))
    assert (inspector.counts["box"], inspector.counts["unsaid"]) == (1, 1)


def test_policies_up_to_the_edges_play_legally(problem):
    counts = play(problem, np.array([0.1, 2.0**31, 2.0**63, 1e38]))
    assert counts["steps"] == 12
    assert counts["unsaid"] == 0
    assert [counts[name] for name in ("type", "box", "count", "precondition")] == [0] * 4


@pytest.mark.long
def test_a_row_a_problem(tmp_path, monkeypatch):
    monkeypatch.setattr(each, "run_guarded", in_this_process)
    limits = Limits(300, 8)
    records = run_legal_play(tmp_path, ["TSP_or"], 3, 2, limits)
    (row,) = records.rows
    assert (row["status"], row["unsaid"], row["policies"]) == ("ok", "0", "3")
    assert 3 <= int(row["steps"]) <= 6
    assert "1 of 1 problems were played" in legal_play_table(records)
    assert run_legal_play(tmp_path, ["TSP_or"], 3, 2, limits).rows == records.rows
