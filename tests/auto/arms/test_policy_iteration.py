"""The arm that learns a value, in slices by a clock that does not wait."""

import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.problems import assert_same_bits
from helpers.toys import toy

from mdpo_rddl.auto import RaceOptions, race
from mdpo_rddl.auto.arms.policy_iteration import GREEDY, PolicyIterationArm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.judge import Judge
from mdpo_rddl.auto.state import State
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.policy_iteration.learner import Shown
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.policy.policy import Policy

# a program of its own is compiled for them all
pytestmark = pytest.mark.long
SECONDS = 300.0
# 3 for the best of three arms, of which one may be pulled, at each of 4 steps
BEST = 3.0 * 0.75 * 4


@pytest.fixture(scope="module")
def compiled():
    words = {"LIKELIHOOD": "0.75", "DISCOUNT": "1.0", "TERMINATION": "false", "MOST": "1"}
    problem = toy("lever", RULES="forall_{?a : arm} [pull(?a) => true];", **words)
    arena = race._arena(problem, preset(SECONDS), 0, time.monotonic(), RaceOptions())
    arm = PolicyIterationArm(arena, 0.0)
    arena.judge.record(arena.candidate("", "no-op", arena.noop))
    arm._compile()
    return arena, arm


@pytest.fixture
def arena(compiled):
    """One whose judge knows the no-op only, and whose clock ticks."""
    clock = Ticking()
    judge = Judge(128, 0, clock, 0.0)
    judge._players = compiled[0].judge._players
    arena = replace(compiled[0], judge=judge, clock=clock, began=0.0, deadline=SECONDS)
    judge.record(arena.candidate("", "no-op", arena.noop))
    return arena


@pytest.fixture
def make(arena, compiled, monkeypatch):
    """An arm whose programs are compiled already."""
    monkeypatch.setattr(PolicyIterationArm, "_is_compiled", lambda arm, until: True)
    monkeypatch.setattr(PolicyIterationArm, "_start", lambda arm, program, in_turn=True: program())

    def one(until: float = 120.0) -> PolicyIterationArm:
        arm = PolicyIterationArm(arena, until)
        arm._planner, arm._iteration = compiled[1]._planner, compiled[1]._iteration
        return arm

    return one


def taken(arm: PolicyIterationArm, judge: Judge) -> list[Candidate]:
    """The candidates of a slice, as the judge sees them."""
    found = []
    for candidate in arm.take_candidates():
        judge.record(candidate)
        found.append(judge.judged[-1].candidate)
        arm.judged(found[-1])
    return found


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


def test_it_is_the_same_at_each_repetition(arena, make):
    found = []
    for _ in range(2):
        arena.clock.now = 0.0
        arm = make()
        arm.work(30.0)
        found += [arm.take_candidates()[0]]
    assert_same_bits(found[0].params, found[1].params)


def test_it_begins_with_the_best_policy_so_far(arena, make):
    own = {"pull": {**arena.noop["own"]["pull"], "bias": np.array([-9.0, -9.0, 9.0], np.float32)}}
    known = arena.candidate("other", "known", {**arena.noop, "own": own})
    arena.judge.record(known)
    arm, seen = make(), []
    iterate = arm._iteration.iterate
    arm._iterated = lambda learner, key, step, is_first=False: (
        seen.append(
            np.mean(
                (found := PolicyIterationArm._iterated(arm, learner, key, step, is_first))[1][0]
            )
        )
        or found
    )
    assert iterate is arm._iteration.iterate
    arm.work(arena.clock.now + 20.0)
    # the first rollouts are that one's
    assert seen[0] == pytest.approx(BEST, rel=0.2)
    assert arm._parents == ("other",)


def test_what_was_learnt_before_an_interruption_is_offered(arena, make, monkeypatch):
    arm = make()
    arm.work(arena.clock.now + 40.0)
    taken(arm, arena.judge)
    calls, iterated = [], arm._iterated

    def interrupted(*arguments):
        calls.append(arguments)
        if len(calls) == 4:
            raise Cancelled
        return iterated(*arguments)

    monkeypatch.setattr(arm, "_iterated", interrupted)
    with pytest.raises(Cancelled):
        arm.work(arena.clock.now + 100.0)
    assert len(arm.take_candidates()) == 2


def test_another_process_goes_on_with_the_value(arena, make):
    arm = make()
    assert arm.state() is None
    arm.work(arena.clock.now + 5.0)
    left = arm.state()
    left = State(dict(left.tensors), json.loads(json.dumps(dict(left.values))))
    later = make()
    later.restore(left)
    assert later.state() is left  # before its program is compiled
    later._go_on(later._iteration.begin(later._first_key), left)
    assert_same_bits(later._learner.weights, arm._learner.weights)
    assert_same_bits(later._learner.moments, arm._learner.moments)
    assert later._part == arm._part
    # what was fitted to is not kept
    assert not np.any(later._learner.kept.counts)
    later.take_over(arm.log, False)
    done = arm.log.iterations
    later.work(arena.clock.now + 5.0)
    assert later.log.iterations > done


@pytest.mark.parametrize(
    "change",
    [
        lambda tensors, values: tensors.update({"learner/0": np.zeros(99)}),
        lambda tensors, values: tensors.update(
            {"learner/0": np.full_like(tensors["learner/0"], np.nan)}
        ),
        lambda tensors, values: tensors.pop("learner/3"),
        lambda tensors, values: values.update(ends=math.inf),
        lambda tensors, values: values.update(parents=None),
    ],
)
def test_a_state_that_does_not_fit_is_left_out(arena, make, change):
    arm = make()
    arm.work(arena.clock.now + 1.0)
    left = arm.state()
    tensors, values = dict(left.tensors), dict(left.values)
    change(tensors, values)
    later = make()
    like = later._iteration.begin(later._first_key)
    assert not later._try(lambda state: later._go_on(like, state), State(tensors, values))
    assert later.state() is None


def test_returns_that_are_not_finite_end_it(arena, make, monkeypatch):
    for mean, is_finite in ((np.nan, True), (1.0, False)):
        arm, broken = make(), Shown(np.full(2, mean, np.float32), np.array(is_finite))
        monkeypatch.setattr(arm, "_iterated", lambda learner, *_, s=broken, **__: (learner, s))
        arm.work(arena.clock.now + 100.0)
        assert arm.is_exhausted
        assert "not finite" in arm.log.details["cause"]
        assert arm.take_candidates() == []


def test_iterations_that_take_too_long_end_it(arena, make, monkeypatch):
    arm, shown = make(), Shown(np.ones(2, np.float32), np.array(True))

    def slow(learner, *_, **__):
        arena.clock.now += 10.0
        return learner, shown

    monkeypatch.setattr(arm, "_iterated", slow)
    arm.work(arena.clock.now + 100.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"].startswith("an iteration takes 1")
    assert arm.log.iterations <= 3


def test_steps_fall_to_the_end_of_each_part(arena, make):
    arm = make()
    arm._part = 10.0, 20.0
    steps = [arm._step(now) / 3e-3 for now in (10.0, 15.0, 19.999, 20.001, 160.0, SECONDS)]
    assert steps == pytest.approx([1.0, 0.5, 0.05, 0.3, 0.15, 0.3 * 0.05], rel=1e-3)


def test_what_is_handed_in_is_told_by_rollouts_that_it_was_not_learnt_from(arena, make):
    arm, played = make(), []
    iterated = arm._iterated

    def noted(learner, key, step, is_first=False):
        found = iterated(learner, key, step, is_first)
        played.append((key.tolist(), step, found[1].returns))
        return found

    arm._iterated = noted
    arm.work(arena.clock.now + 30.0)
    candidate, _ = arm.take_candidates()
    *learnt, (key, step, returns), (same_key, _, _) = played
    assert (step, same_key) == (0.0, key)
    assert key not in [each[0] for each in learnt]
    assert candidate.mean == pytest.approx(float(np.mean(returns)))
    assert candidate.error == pytest.approx(np.std(returns, ddof=1) / math.sqrt(len(returns)))
    # the judge's own rollouts, of the same model, agree
    arena.judge.record(replace(candidate, mean=None))
    judged = arena.judge.judged[-1].candidate
    difference = abs(judged.known_mean - candidate.mean)
    assert difference < 4.0 * math.hypot(judged.error, candidate.error) + 1e-6
