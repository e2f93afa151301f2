"""The arm that learns a value, in slices by a clock that does not wait."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.learners import BEST, SECONDS, compiled_arm, known, taken, ticking_arena
from helpers.problems import assert_same_bits

from mdpo_rddl.auto.arms import policy_iteration
from mdpo_rddl.auto.arms.policy_iteration import GREEDY, PolicyIterationArm
from mdpo_rddl.auto.common.span import Span
from mdpo_rddl.planner.policy_iteration.learner import Shown
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.policy.policy import Policy

# a program of its own is compiled for them all
pytestmark = pytest.mark.long


@pytest.fixture
def arena():
    return ticking_arena()


@pytest.fixture
def make(arena):
    return lambda until=120.0: compiled_arm(arena, until)


def noting(arm):
    """What each iteration of an arm is given from now on, and what its policy returns."""
    played, iterated = [], arm._iterated

    def noted(learner, key, step, is_first=False):
        found = iterated(learner, key, step, is_first)
        played.append((key.tolist(), step, found[1].returns))
        return found

    arm._iterated = noted
    return played


def test_the_best_action_is_learnt_saved_and_played(arena, make, tmp_path):
    arm = make()
    assert (arm.name, arm.progress, arm.descends) == (GREEDY, -math.inf, False)
    arm.work(arena.clock.now + 40.0)
    found = taken(arm, arena.judge)
    best = max(found, key=lambda candidate: candidate.known_mean)
    assert best.known_mean == pytest.approx(BEST, rel=0.1)
    assert arm.reached == best.mean
    assert arm.progress == pytest.approx(BEST, rel=0.2)
    assert arena.judge.incumbent is best
    assert best.label.startswith("greedy, iteration")
    given = best.config, best.planner, best.params, best.policy_hyperparams
    policy = Policy(arena.problem, *given, seed=0)
    policy.save(tmp_path / "policy.safetensors")
    saved = load_policy(tmp_path / "policy.safetensors")
    loaded = restored(saved, arena.problem, "file")
    assert_same_bits(loaded.params, best.params)
    state = {"pulled": np.zeros(3, bool)}
    assert loaded(0, state)["pull"].tolist() == [False, False, True]


def test_it_begins_with_the_best_policy_so_far(arena, make):
    arena.judge.record(known(arena))
    arm = make()
    played = noting(arm)
    arm.work(arena.clock.now + 20.0)
    # the first rollouts are that one's
    half = len(played[0][2]) // 2
    assert np.mean(played[0][2][:half]) == pytest.approx(BEST, rel=0.2)
    assert arm._parents == ("other",)


def test_the_guide_is_known_by_the_first_iteration(arena, make):
    arena.judge.record(replace(known(arena), mean=10.0 * BEST, error=0.0))
    make().work(arena.clock.now + 1.0)
    incumbent = arena.judge.incumbent
    assert incumbent.label == "known"
    assert incumbent.mean == pytest.approx(BEST, rel=0.1)
    assert incumbent.error > 0.0


def test_where_nothing_was_learnt_nothing_is_offered(arena, make, monkeypatch):
    arm, broken = make(), Shown(np.full(2, np.nan, np.float32), np.array(True))
    monkeypatch.setattr(arm, "_iterated", lambda learner, *_, **__: (learner, broken))
    arm.work(arena.clock.now + 100.0)
    assert arm.is_exhausted
    assert arm.take_candidates() == []


def test_what_would_take_too_long_is_not_compiled(arena):
    arm = PolicyIterationArm(arena, 120.0, batch_seconds=1000.0)
    arm.begin(arena.clock.now + 100.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"].startswith("an iteration would take ")
    assert not hasattr(arm, "_iteration")
    arm.work(arena.clock.now + 100.0)
    assert arm.log.iterations == 0
    assert arm.take_candidates() == []


def test_what_may_be_in_time_is_compiled(arena, monkeypatch):
    arm = PolicyIterationArm(arena, 120.0, batch_seconds=0.01)
    monkeypatch.setattr(policy_iteration, "PolicyIteration", lambda *_: pytest.fail("it is"))
    with pytest.raises(pytest.fail.Exception, match="it is"):
        arm._compile()


def test_the_first_iteration_that_takes_too_long_ends_it(arena, make, monkeypatch):
    arm, shown = make(), Shown(np.ones(2, np.float32), np.array(True))

    def slow(learner, *_, **__):
        arena.clock.now += 25.0
        return learner, shown

    monkeypatch.setattr(arm, "_iterated", slow)
    arm.work(arena.clock.now + 100.0)
    assert arm.is_exhausted
    # in a race of 300 s no more than 6, and 24 where it makes four times as many updates
    assert arm.log.details["cause"].startswith("an iteration takes 6")
    assert arm.log.iterations == 1
    assert arm.take_candidates() == []


def test_steps_fall_to_the_end_of_each_part(arena, make):
    arm = make()
    arm._span = Span(10.0, 20.0)
    steps = [arm._pace(now) / 3e-3 for now in (10.0, 15.0, 19.999, 20.001, 160.0, SECONDS)]
    assert steps == pytest.approx([1.0, 0.5, 0.05, 0.3, 0.15, 0.3 * 0.05], rel=1e-3)


def test_what_is_handed_in_is_told_by_rollouts_that_it_was_not_learnt_from(arena, make):
    arm = make()
    played = noting(arm)
    arm.work(arena.clock.now + 30.0)
    candidate = arm.take_candidates()[0]
    learnt = [each for each in played if each[1] > 0.0]
    key, _, returns = played[len(learnt)]
    assert {each[0] == key for each in played[len(learnt) :]} == {True}
    assert key not in [each[0] for each in learnt]
    assert candidate.mean == pytest.approx(float(np.mean(returns)))
    assert candidate.error == pytest.approx(np.std(returns, ddof=1) / math.sqrt(len(returns)))
    # the judge's own rollouts, of the same model, agree
    arena.judge.record(replace(candidate, mean=None))
    judged = arena.judge.judged[-1].candidate
    difference = abs(judged.known_mean - candidate.mean)
    assert difference < 4.0 * math.hypot(judged.error, candidate.error) + 1e-6


@pytest.mark.parametrize("lead", [-1.0, 1.0])
def test_an_earlier_policy_is_handed_in_where_its_rollouts_have_returned_more(arena, make, lead):
    arm = make()
    arm.work(arena.clock.now + 30.0)
    latest = arm.take_candidates()[0]
    mean, error = arm._returned(arm._learner)
    earlier = {name: getattr(arm._begun(), name) for name in ("weights", "times", "scale")}
    best = arm._best._replace(mean=mean + (2.0 + lead) * error + lead, iteration=2, kept=earlier)
    arm._best = best
    arm._offer_learnt()
    again, *others = arm.take_candidates()
    assert_same_bits(again.params, latest.params)
    assert [other.label for other in others] == (["greedy, iteration 2"] if lead > 0.0 else [])
    for other in others:
        assert not np.any(other.params["output"])
