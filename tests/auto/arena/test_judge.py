"""Candidates are compared in the same fresh rollouts, and the best is remembered."""

import dataclasses
import math

import jax
import numpy as np
import pytest
from helpers.clocks import Stopped, Ticking
from helpers.lakes import preset, write_lake
from helpers.toys import toy

from mdpo_rddl.auto.arena.judge import ROLLOUTS, Judge, difference_error, rollouts_for
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.probing.constants import with_bias
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.exact import LOST, compile_exact_returns
from mdpo_rddl.problem.evaluation import mean_and_error


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    lake = write_lake(tmp_path_factory.mktemp("lake"))
    return build_planner(lake, without_scales(preset(1.0))).planner


def judge(rollouts: int = 4) -> Judge:
    clock = Ticking()
    return Judge(rollouts, seed=3, clock=clock, began=clock())


def known(label: str, mean: float, error: float = 1.0, planner=None) -> Candidate:
    config = preset(1.0)
    return Candidate("arm", label, config, planner, {}, mean=mean, error=error)


def test_a_return_that_is_no_number_loses():
    one = judge()
    assert one.best_mean == -math.inf
    assert one.record(known("broken", float("nan"), float("nan")))
    assert one.record(known("bad", -5.0))
    assert not one.record(known("broken", float("nan"), 0.0))
    assert one.incumbent.label == "bad"
    assert (one.best_mean, one.incumbent.error) == (-5.0, 1.0)
    assert [judged.became_incumbent for judged in one.judged] == [True, True, False]
    assert one.judged[-1].candidate.mean == -math.inf


def test_what_one_rollout_takes_is_known_once_they_were_compiled(planner):
    one = judge(4)
    assert one.one_rollout_seconds == 0.0
    noop = planner.feedback_plan.noop(0)
    for number, expected in enumerate([0.0, 0.25]):
        one.record(Candidate("arm", f"{number}", preset(1.0), planner, noop))
        # the clock ticks once in a call
        assert one.one_rollout_seconds == pytest.approx(expected * one.rollout_seconds)
    assert one.rollout_seconds > 0.0


def test_who_is_known_or_has_been_played_takes_no_compilation(planner):
    one = judge()
    played = Candidate("arm", "rule", preset(1.0), planner, planner.feedback_plan.noop(0))
    assert not one.is_ready(played)
    assert one.is_ready(known("known", 0.0))
    one.record(played)
    assert one.is_ready(played)
    assert not one.is_ready(dataclasses.replace(played, planner=None))


def test_no_rollouts_are_compiled_that_would_come_too_late(planner):
    late = Judge(4, seed=3, clock=Stopped(6.0), began=0.0, deadline=10.0)
    noop = Candidate("arm", "noop", preset(1.0), planner, planner.feedback_plan.noop(0))
    late.program_seconds = 5.0
    with pytest.raises(TooLateError, match="too little time is left"):
        late.record(noop)
    # what is known needs none
    assert late.record(known("known", 1.0))
    late.program_seconds = 3.0
    late.record(noop)
    # those that are there go on
    late.program_seconds = 5.0
    late.record(noop)
    assert [judged.candidate.label for judged in late.judged] == ["known", "noop", "noop"]


def test_candidates_of_one_planner_must_be_better_and_others_by_an_error():
    one, planner = judge(), object()
    assert one.record(known("first", 0.0, 3.0, planner))
    assert not one.record(known("equal", 0.0, 0.0, planner))
    assert one.record(known("paired", 0.1, 3.0, planner))
    # the difference's standard error is 5
    assert not one.record(known("other", 5.0, 4.0))
    assert one.record(known("other", 5.2, 4.0))
    assert one.best_of(planner).label == "paired"


def rolled(label: str, returns: list[float]) -> Candidate:
    one = known(label, float(np.mean(returns)))
    return dataclasses.replace(one, returns=np.array(returns))


def test_what_was_known_by_few_rollouts_is_corrected_and_loses_its_lead():
    one = judge()
    noop, lucky, exact = known("no-op", 1.0, 0.0), known("lucky", 9.0, 0.0), known("exact", 2.0)
    for candidate in (noop, exact, lucky):
        one.record(candidate)
    noop, exact, lucky = (each.candidate for each in one.judged)
    assert one.incumbent is lucky
    one.correct(lucky, np.array([2.5, np.nan]))
    one.correct(exact, np.array([90.0, 92.0]))
    assert (one.incumbent, exact.mean) == (lucky, 2.0)
    one.correct(lucky, np.array([2.5, 3.5]))
    corrected = one.incumbent
    assert (corrected.label, corrected.mean, corrected.error) == ("lucky", 3.0, 0.5)
    # more is known of it by now
    one.correct(corrected, np.array([0.0, 1.0]))
    assert one.incumbent is corrected
    one.correct(noop, np.array([4.0, 5.0]))
    assert one.incumbent is corrected
    assert [each.candidate.mean for each in one.judged] == [4.5, 2.0, 3.0]


def test_another_one_leads_where_the_incumbent_was_lucky():
    one = judge()
    for candidate in (known("no-op", 1.0, 0.0), known("lucky", 9.0, 0.0)):
        one.record(candidate)
    one.correct(one.incumbent, np.array([-2.0, -1.0]))
    assert one.incumbent.label == "no-op"
    told = [(each.candidate.label, each.became_incumbent) for each in one.judged]
    assert told == [("no-op", True), ("lucky", True), ("no-op", True)]


def test_how_many_rollouts_are_lost_decides_before_any_error():
    all_lost, one_lost = [LOST] * 4, [3.0, LOST, 1.0, 9.0]
    assert difference_error(rolled("a", all_lost), rolled("b", [0.0] * 4)) == 0.0
    # of 4, -5 and 6 the error is
    error = difference_error(rolled("a", one_lost), rolled("b", [-1.0, 7.0, 6.0, 3.0]))
    assert error == pytest.approx(np.std([4.0, -5.0, 6.0], ddof=1) / np.sqrt(3))


def test_an_arm_goes_on_from_what_another_process_has_left():
    one = judge()
    assert one.record(known("left", 0.0, 3.0))
    assert one.record(known("better", 0.1, 3.0, object()))
    assert not one.record(dataclasses.replace(known("others", 0.2, 3.0), arm="another"))


def test_candidates_are_known_by_their_labels_and_dated():
    one = judge()
    for mean in (1.0, 0.0):
        one.record(known("twice", mean, 0.1))
    assert one.latest("twice").mean == 0.0
    assert one.latest("never") is None
    assert one.became_incumbent("twice")
    assert not one.became_incumbent("never")
    assert [judged.seconds for judged in one.judged] == [1.0, 2.0]


def test_the_mean_is_that_of_common_rollouts_that_no_search_sees(planner):
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    better = with_bias(params, {"pump": np.array(40.0)})
    one = judge(rollouts=8)
    assert one.rollout_seconds == 0.0
    candidate = dataclasses.replace(known("no-op", 0.0), planner=planner, params=params, mean=None)
    assert one.record(candidate)
    assert one.record(dataclasses.replace(candidate, params=better, label="constant"))
    # the clock ticks once while they are played
    assert one.rollout_seconds == 1.0
    returns = compile_exact_returns(planner, 8)
    key = jax.random.fold_in(jax.random.PRNGKey(3), 1)
    both = jax.tree.map(lambda *leaves: np.stack(leaves), params, better)
    means = np.mean(np.asarray(returns(key, both), float), axis=1)
    assert [judged.candidate.mean for judged in one.judged] == pytest.approx(means, rel=1e-5)
    # another seed, other rollouts
    other = Judge(8, seed=4, clock=Ticking(), began=0.0)
    other.record(candidate)
    assert other.best_mean != one.judged[0].candidate.mean
    assert one.compile_seconds >= 0.0


def test_without_a_planner_and_a_mean_there_is_no_saying():
    with pytest.raises(ValueError, match="no planner"):
        judge().record(dataclasses.replace(known("unknown", 0.0), mean=None))
    with pytest.raises(ValueError, match="not judged yet"):
        _ = dataclasses.replace(known("unknown", 0.0), mean=None).known_mean


def played(returns_of: dict[str, list[float]]) -> Judge:
    """A judge that has played these, all of one planner, in turn."""
    one, planner = judge(), object()
    one._players.append((planner, np.array))
    for label, returns in returns_of.items():
        candidate = dataclasses.replace(known(label, 0.0, planner=planner), mean=None)
        one.record(dataclasses.replace(candidate, params=returns))
    return one


def test_in_few_rollouts_a_candidate_must_be_better_by_the_error_of_the_difference():
    # 1 better in the mean, with an error of 2
    assert played({"first": [0.0, 0.0], "lucky": [3.0, -1.0]}).incumbent.label == "first"
    # and of 0.5
    assert played({"first": [0.0, 0.0], "better": [1.5, 0.5]}).incumbent.label == "better"
    many = played({"first": [0.0] * 64, "better": [3.0, -1.0] * 32})
    assert many.incumbent.label == "better"
    assert many.latest("first").error == 0.0


def test_errors_are_those_of_a_sample():
    assert mean_and_error(np.array([0.0, 2.0])) == (1.0, 1.0)
    assert mean_and_error(np.array([3.0])) == (3.0, math.inf)


def test_where_the_environment_fails_more_rollouts_tell_how_often():
    kettle = toy("kettle", TERMINATION="false")
    assert rollouts_for(kettle) == ROLLOUTS
    assert rollouts_for(dataclasses.replace(kettle, raises=True)) == 1024
