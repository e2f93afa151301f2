"""A policy that the exact environment pays less than the judge's rollouts did."""

import math
import threading
import time
from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.races import CLOCK, raced
from helpers.toys import toy

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.outcome import confirmation
from mdpo_rddl.auto.outcome.confirmation import confirmed, episodes_of, is_less, less_than_judged
from mdpo_rddl.auto.outcome.outcome import policy_of
from mdpo_rddl.auto.probing.constants import with_bias
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.exact import LOST
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import load_problem, make_environment

JUDGED = Candidate(
    "own weights",
    "own weights",
    config=None,
    planner=None,
    params={},
    mean=100.0,
    error=1.0,
    returns=np.full(128, 100.0),
)
# 0.7 is 0.69999999 in 32 bit, so that less is on in the environment than in the model
THRESHOLD_DOMAIN = """
domain threshold {
    pvariables {
        past : { state-fluent, real, default = 0.0 };
        power : { action-fluent, real, default = 0.0 };
    };
    cpfs { past' = power; };
    reward = if (power >= 0.7) then 10.0 - power else 0.0;
}
"""
THRESHOLD_INSTANCE = """
non-fluents nf { domain = threshold; }
instance one {
    domain = threshold; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 4; discount = 1.0;
}
"""


def played(*returns):
    return Evaluation(np.array(returns), np.ones(len(returns), int), 0, 0)


@pytest.mark.parametrize(
    ("returns", "less"),
    [
        ((94.0, 94.0, 94.0), True),  # 4 errors of 1, and a hundredth
        ((95.5, 95.5, 95.5), False),
        ((94.0, 80.0, 108.0), False),  # its own error is 8.1
        ((-300.0, -310.0), True),
        ((130.0, 130.0), False),
        ((0.0,), False),
    ],
)
def test_less_than_the_errors_allow_is_told(returns, less):
    assert is_less(JUDGED, played(*returns)) == less
    said = less_than_judged(JUDGED, played(*returns))
    assert ("100: the policy may sit on a threshold" in said) == less
    assert bool(said) == less


def test_nothing_is_said_of_what_no_rollouts_were_made_of():
    assert not is_less(replace(JUDGED, returns=None), played(0.0, 0.0))
    assert not is_less(replace(JUDGED, returns=None, mean=None), played(0.0, 0.0))


class Judged(Judge):
    """A judge who has said so much of each arm's candidate."""

    def __init__(self, **means):
        clock = Ticking()
        super().__init__(128, 0, clock, clock())
        for arm, mean in means.items():
            self.record(replace(JUDGED, arm=arm, label=arm, mean=mean))
        for at, one in enumerate(self.judged):
            candidate = replace(one.candidate, returns=JUDGED.returns)
            self.judged[at] = replace(one, candidate=candidate)
            if one.candidate is self.incumbent:
                self.incumbent = candidate


def result(judge, rounds=(True,) * 9, **returns):
    """The arm of the result where the environment pays each arm so much in all ten episodes."""
    times = iter(rounds)
    spread = np.linspace(-0.5, 0.5, 10)
    return confirmed(judge, lambda it: played(*(returns[it.arm] + spread)), lambda: next(times)).arm


def test_who_is_paid_what_was_promised_stays():
    assert result(Judged(one=100.0, other=90.0), one=99.0) == "one"


def test_another_arm_takes_the_place_of_one_that_is_not(caplog):
    judge = Judged(third=80.0, other=90.0, one=100.0)
    assert result(judge, one=10.0, other=90.0, third=80.0) == "other"
    assert "paid 10 where the judge's rollouts had 100" in caplog.text
    assert "'other' is the result, to which it paid 90" in caplog.text
    # neither is one that is itself paid less, nor one that returns less still
    assert result(judge, one=10.0, other=50.0, third=80.0) == "third"
    assert result(judge, one=10.0, other=50.0, third=40.0) == "one"
    judge = Judged(other=9.0, one=100.0)
    assert result(judge, one=10.0, other=9.0) == "one"


def test_a_rule_without_rollouts_hides_no_rival_of_its_arm():
    judge = Judge(128, 0, Ticking(), 0.0)
    shared = replace(JUDGED, arm="constants and rules", label="random rule", mean=50.0)
    early = replace(shared, label="early rule", mean=90.0, returns=None)
    for each in (shared, early, JUDGED):
        judge.record(each)
    assert judge.incumbent.label == JUDGED.label
    found = confirmation._rivals(judge, judge.incumbent)
    assert [one.label for one in found] == ["random rule"]


def test_where_time_is_over_the_incumbent_stays():
    judge = Judged(third=80.0, other=90.0, one=100.0)
    returns = {"one": 10.0, "other": 50.0, "third": 80.0}
    assert result(judge, [False], **returns) == "one"
    assert result(judge, [True, True, False], **returns) == "one"


def test_few_episodes_say_nothing():
    judge = Judged(other=90.0, one=100.0)
    assert confirmed(judge, lambda it: played(*[0.0] * 4), lambda: True).arm == "one"


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    folder = tmp_path_factory.mktemp("threshold")
    domain, instance = folder / "d.rddl", folder / "i.rddl"
    domain.write_text(THRESHOLD_DOMAIN)
    instance.write_text(THRESHOLD_INSTANCE)
    return load_problem(str(domain), str(instance))


@pytest.fixture(scope="module")
def noop(problem):
    config = without_scales(preset(1.0))
    planner = build_planner(problem, config).planner
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    return Candidate("no-op", "no-op", config, planner, params)


def constant(noop, arm, power):
    params = with_bias(noop.params, {"power": np.array(power)})
    return replace(noop, arm=arm, label=arm, params=params)


def test_a_policy_on_a_threshold_is_left_for_one_beside_it(problem, noop):
    clock = Ticking()
    judge = Judge(4, seed=0, clock=clock, began=clock())
    judge.record(constant(noop, "beside it", 0.75))
    judge.record(constant(noop, "on it", 0.7))
    assert judge.incumbent.label == "on it"
    assert judge.best_mean == pytest.approx(4 * 9.3, rel=1e-5)

    play = episodes_of(problem, 0, (clock() + 100.0, math.inf), clock)
    assert play(judge.incumbent).mean == 0.0
    chosen = confirmed(judge, play, lambda: True)
    assert chosen.label == "beside it"
    assert play(chosen).mean == pytest.approx(4 * 9.25, rel=1e-5)


def test_episodes_end_with_the_time_but_for_the_fewest(problem, noop):
    clock = Ticking()
    assert len(episodes_of(problem, 0, (0.0, math.inf), clock)(noop).returns) == 5
    later = clock() + 1000.0
    assert len(episodes_of(problem, 0, (later, later), clock)(noop).returns) == 10


def test_a_policy_that_plays_too_slowly_is_not_played_to_the_end(problem, noop):
    clock = Ticking()
    began = clock()
    judge = Judge(4, seed=0, clock=clock, began=began)
    judge.record(constant(noop, "beside it", 0.75))
    judge.record(constant(noop, "on it", 0.7))
    began = clock()
    # 20 decisions would be needed
    play = episodes_of(problem, 0, (began, began + 12.0), clock)
    assert confirmed(judge, play, lambda: True).label == "on it"
    assert clock() == began + 13.0


def test_a_policy_that_makes_the_environment_fail_is_left_for_another():
    problem = toy("sail")
    config = without_scales(preset(1.0))
    planner = build_planner(problem, config).planner
    start = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    clock = Ticking()
    judge = Judge(4, seed=0, clock=clock, began=clock())
    for arm, value, mean in (("astern", -0.1, 50.0), ("ahead", 0.5, 12.0)):
        params = with_bias(start, {"set": np.array(value)})
        returns = np.full(4, mean)
        told = {"mean": mean, "error": 0.0, "returns": returns}
        judge.record(Candidate(arm, arm, config, planner, params, **told))
    assert judge.incumbent.label == "astern"

    play = episodes_of(problem, 0, (clock() + 100.0, math.inf), clock)
    assert play(judge.incumbent).mean == LOST
    assert confirmed(judge, play, lambda: True).label == "ahead"


def test_a_program_that_compiles_too_slowly_is_not_waited_for(problem, noop, monkeypatch):
    is_over = threading.Event()

    def of(candidate, problem, seed):
        policy = policy_of(candidate, problem, seed)

        def decide(step, state):
            is_over.wait()
            return policy(step, state)

        return decide

    monkeypatch.setattr(confirmation, "policy_of", of)
    play = episodes_of(problem, 0, (time.monotonic(), time.monotonic() + 0.5), time.monotonic)
    with pytest.raises(TooLateError):
        play(noop)  # whose decisions would never end
    is_over.set()


@pytest.mark.long
def test_a_race_confirms_its_result(problem, caplog):
    def on_threshold(arena):
        params = with_bias(arena.noop, {"power": np.array(0.7)})
        return [Candidate("mine", "on it", arena.config, arena.planner, params)]

    options = RaceOptions(clock=CLOCK, most_iterations=60, initial=on_threshold)
    outcome = raced(problem, 1500.0, options)
    assert evaluate(make_environment(problem), outcome.policy, 1, 0).mean > 30.0
    # the incumbent was the one on the threshold
    leaders = [one.candidate.label for one in outcome.judged if one.became_incumbent]
    assert leaders[-2:] == ["on it", outcome.chosen.label]
    assert f"{outcome.chosen.label!r} is the result" in caplog.text
