"""The arm that tries rules for relaxed plans: what it offers, and when it gives up."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.clocks import Stopped, Ticking
from helpers.couriers import courier, fires
from helpers.lakes import preset
from helpers.toys import problem_from

from mdpo_rddl.auto.arms import relaxed_plans
from mdpo_rddl.auto.arms.relaxed_plans import RELAXED_PLANS, RelaxedPlansArm
from mdpo_rddl.auto.outcome.outcome import policy_of
from mdpo_rddl.auto.race.ground_arms import GroundSlices
from mdpo_rddl.auto.race.options import RaceOptions
from mdpo_rddl.auto.search.optimum import find_optimum
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.config.search_section import Search
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.relaxed_plans import RelaxedPlans
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import open_model

LIMITS = EnumerationLimits(1e9)


@pytest.fixture(scope="module")
def problem():
    return courier()


def made(problem, clock=None, pulse=lambda: None, seconds=10.0):
    model = open_model(problem, LIMITS)
    return RelaxedPlansArm(preset(seconds), 0, clock or Ticking(0.001), model, pulse)


def test_it_offers_the_best_rule_with_its_return_in_fresh_episodes(problem):
    arm = made(problem)
    arm.work(1000.0)
    assert arm.is_exhausted
    assert arm.log.iterations == len(relaxed_plans._RULES)
    (candidate,) = arm.take_candidates()
    rule, simulated = candidate.plans
    assert simulated.episodes == 8 * 16
    assert candidate.mean == pytest.approx(find_optimum(problem, 30.0).value, abs=0.2)
    assert (candidate.mean, candidate.error) == (simulated.value, simulated.error)
    policy = policy_of(candidate, problem, 7)
    assert policy._plans is candidate.relaxed
    assert isinstance(policy, RelaxedPlanPolicy)
    assert (policy.plan_rule, policy.seed) == (rule, 7)


def test_it_offers_what_is_best_when_it_is_asked_and_what_more_episodes_say(problem, monkeypatch):
    monkeypatch.setattr(relaxed_plans, "_EPISODES", (4,))
    arm = made(problem, Ticking(1.0), seconds=10_000.0)
    end = 25.0
    assert arm.leading == -math.inf
    assert arm.take_candidates() == []
    offers = []
    while not offers:
        arm.work(end)
        offers = arm.take_candidates()
        end += 25.0
    (first,) = offers
    assert first.mean == arm.leading
    # nothing more is known of it
    assert arm.take_candidates() == []
    count = first.plans[1].episodes
    assert not arm.is_exhausted
    while not arm.is_exhausted:
        arm.work(end)
        end += 25.0
    (last,) = arm.take_candidates()
    assert last.plans[1].episodes == 8 * count
    assert last.mean == arm.leading


def test_an_interruption_keeps_what_was_found(problem):
    steps = 0

    def pulse():
        nonlocal steps
        steps += 1
        if steps > 20:
            raise Cancelled

    arm = made(problem, pulse=pulse)
    with pytest.raises(Cancelled):
        arm.work(1000.0)
    assert len(arm.take_candidates()) == 1


def test_it_gives_up_where_plans_gain_nothing(problem, monkeypatch):
    arm = made(problem)
    monkeypatch.setattr(RelaxedPlansArm, "_best", property(lambda self: None))
    arm.work(1000.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "its plans return no more than the no-op"
    assert arm.log.iterations == relaxed_plans._PATIENCE
    assert not arm.take_candidates()


def test_it_gives_up_where_every_reward_can_be_had_at_once():
    model = replace(open_model(courier(), LIMITS), first=(False, False, True, True))
    arm = RelaxedPlansArm(preset(10.0), 0, Ticking(0.001), model)
    arm.work(1000.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "no reward that is a step or more away"


def test_it_plans_for_what_comes_up_by_chance_later():
    # a fire, which is put out where there is water
    model = open_model(fires(), LIMITS)
    arm = RelaxedPlansArm(preset(10.0), 0, Ticking(0.001), model)
    arm.work(1000.0)
    (candidate,) = arm.take_candidates()
    assert candidate.mean > np.mean(arm._returns[None]) + 1.0


def slowed(monkeypatch, seconds):
    """Decisions take so many seconds each, by a clock whose time is the one entry of a list."""
    now, decide = [0.0], relaxed_plans.RelaxedPlans.decide

    def slow(*args):
        now[0] += seconds
        return decide(*args)

    monkeypatch.setattr(relaxed_plans.RelaxedPlans, "decide", slow)
    return now


def test_it_waits_for_a_slice_in_which_a_rule_can_be_played(problem, monkeypatch):
    now = slowed(monkeypatch, 5.0)
    arm = made(problem, lambda: now[0])
    # eight steps of two episodes would take 40 s
    arm.work(30.0)
    assert arm.is_untried
    assert not arm.is_exhausted
    assert arm.log.details["cause"].startswith("a rule's episodes take")
    arm.work(1000.0)
    assert not arm.is_untried
    assert arm.log.details == {}
    assert arm.take_candidates()


def test_where_episodes_take_long_few_samples_stand_for_what_may_follow(problem, monkeypatch):
    now, decide = [0.0], relaxed_plans.RelaxedPlans.decide

    def slow(self, states, step, rule, uniform):
        assert uniform.shape[1] == rule.samples
        now[0] += 0.5 * rule.samples
        return decide(self, states, step, rule, uniform)

    monkeypatch.setattr(relaxed_plans.RelaxedPlans, "decide", slow)
    arm = made(problem, lambda: now[0], seconds=1000.0)
    # eight steps with eight samples would take 32 s, with two 8 s
    arm.work(40.0)
    (candidate,) = arm.take_candidates()
    assert candidate.plans[0].samples == 2
    longer = made(problem, lambda: now[0], seconds=1000.0)
    longer.work(now[0] + 200.0)
    (candidate,) = longer.take_candidates()
    assert candidate.plans[0].samples == 8


def test_where_episodes_take_long_a_clear_gain_is_enough(problem, monkeypatch):
    now = slowed(monkeypatch, 1.0)
    # eight decisions of two episodes take 8 s, those of four 12 s: what a rule may have of the race
    arm = made(problem, lambda: now[0], seconds=250.0)
    arm.work(1000.0)
    assert arm.is_exhausted
    assert len(arm._returns[None]) == 4
    (candidate,) = arm.take_candidates()
    simulated = candidate.plans[1]
    gain = simulated.value - arm._returns[None].mean()
    assert relaxed_plans._FEWEST_FRESH <= simulated.episodes < 8 * 4
    assert 0.0 <= simulated.error <= 0.02 * gain


@pytest.mark.parametrize(
    ("returns", "noop", "is_clear"),
    [
        ([10.0] * 16, [0.0, 0.0], True),
        # eight that are equal may be so by chance
        ([10.0] * 8, [0.0, 0.0], False),
        ([9.9, 10.1] * 4, [0.0, 0.0], True),
        ([9.9, 10.1] * 3, [0.0, 0.0], False),
        ([5.0, 15.0] * 4, [0.0, 0.0], False),
        # the no-op's error counts, too
        ([9.9, 10.1] * 4, [-1.0, 1.0], True),
        ([9.9, 10.1] * 4, [-10.0, 10.0], False),
        ([9.9, 10.1] * 4, [10.0, 10.0], False),
        ([9.9, 10.1] * 4, [20.0, 20.0], False),
        # nothing to compare with, where the no-op is illegal
        ([9.9, 10.1] * 4, None, False),
    ],
)
def test_a_gain_is_clear_beyond_its_error(problem, returns, noop, is_clear):
    arm = made(problem)
    if noop is not None:
        arm._returns[None] = np.array(noop)
    assert arm._is_clear(np.array(returns)) == is_clear


def timing_state(model):
    arm = RelaxedPlansArm(preset(10.0), 0, Ticking(0.001), model)
    return arm._timing_state(RelaxedPlans(model, LIMITS), LIMITS)[:, 0].tolist()


def test_the_initial_state_tells_how_long_it_takes_if_something_must_be_reached(problem):
    model = open_model(problem, LIMITS)
    assert timing_state(model) == [int(value) for value in model.first]


def test_elsewhere_one_that_comes_up_by_chance():
    # the fire burns, and no water is there
    assert timing_state(open_model(fires(), LIMITS)) == [1, 0]


@pytest.mark.parametrize("horizon", [1, 2])
def test_nothing_can_come_up_in_a_short_episode(horizon):
    model = replace(open_model(fires(), LIMITS), horizon=horizon)
    with pytest.raises(NotEnumerableError, match="a step or more away"):
        timing_state(model)


def test_no_state_counts_after_an_illegal_no_op():
    model = open_model(fires("fill | pour;"), LIMITS)
    with pytest.raises(NotEnumerableError, match="a step or more away"):
        timing_state(model)


def test_it_gives_up_where_no_action_is_legal(problem):
    model = open_model(problem, LIMITS)
    # once the parcel is there
    legal = model.graph.make("or", *model.defaults())
    arm = RelaxedPlansArm(
        preset(10.0), 0, Ticking(0.001), replace(model, legal=(*model.legal, legal))
    )
    arm.work(1000.0)
    assert arm.log.details["cause"] == "no legal action was found in a state"
    assert not arm.take_candidates()


def test_rules_are_compared_with_each_other_where_the_no_op_is_illegal(problem):
    model = open_model(problem, LIMITS)
    # anywhere but at the last place
    legal = model.graph.make("or", *model.defaults(), model.leaf(2))
    assert model.variables[2] == ("at", (2,))
    arm = RelaxedPlansArm(
        preset(10.0), 0, Ticking(0.001), replace(model, legal=(*model.legal, legal))
    )
    arm.work(1000.0)
    assert arm.log.details == {}
    assert arm.log.iterations == 4
    (candidate,) = arm.take_candidates()
    assert candidate.mean > 0.0


def test_an_error_costs_the_arm_only(problem, monkeypatch):
    def broken(*args):
        raise RuntimeError("broken")

    monkeypatch.setattr(relaxed_plans, "RelaxedPlans", broken)
    arm = made(problem)
    arm.work(1000.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "RuntimeError: broken"


def test_it_does_not_know_where_the_environment_fails(problem):
    failing = replace(problem, raises=True)
    options, shares = RaceOptions(clock=Stopped()), Search()
    begun = [
        GroundSlices(each, preset(100.0), 0, options, shares).arms.all
        for each in (problem, failing)
    ]
    # without what looks for the optimum no arm has a ground model
    assert [[arm.name for arm in arms] for arms in begun] == [["dynamic programming"], []]


@pytest.mark.parametrize("without", [[], [RELAXED_PLANS]])
def test_it_works_before_the_trials_unless_it_is_left_out(problem, without):
    options = RaceOptions(clock=Stopped())
    shares = Search(without=["dynamic programming", "trials", *without])
    ground = GroundSlices(problem, preset(100.0), 0, options, shares)
    stages = []
    ground.enumerate(100.0)
    ground.search(100.0, stages.append)
    assert ground.arms.exact.grounded.opened is not None
    assert ground.arms.trials is None
    names = [arm.name for arm in ground.arms.all]
    assert names == ["dynamic programming", *([] if without else [RELAXED_PLANS])]
    assert stages == ([] if without else ["searching"])
    if not without:
        (found,) = ground.arms.plans.take_candidates()
        assert found.relaxed is not None


def test_what_a_state_would_pay_after_the_end_does_not_count():
    # 1 / 0 once the door is open, where an episode has ended while others go on
    problem = problem_from(
        """domain doors {
    pvariables {
        key : { state-fluent, bool, default = false };
        open : { state-fluent, bool, default = false };
        take : { action-fluent, bool, default = false };
        turn : { action-fluent, bool, default = false };
    };
    cpfs { key' = key | take; open' = open | (key ^ turn ^ Bernoulli(0.5)); };
    reward = (10 * (key ^ turn)) - (1 / (1 - open));
    termination { open; };
}
non-fluents n { domain = doors; }
instance inst {
    domain = doors; non-fluents = n; max-nondef-actions = 1; horizon = 6; discount = 1.0;
}"""
    )
    arm = made(problem)
    arm.work(1000.0)
    (candidate,) = arm.take_candidates()
    # ten for each turn of the key, some of which fail, and one for each step lost
    assert 8.0 < candidate.mean < 35.0
