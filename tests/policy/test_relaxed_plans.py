"""Decisions by relaxed plans, and the policy that makes them: played, saved, read back, refused."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.couriers import camera, courier, lift, tower
from helpers.mistakes import one_line
from helpers.toys import toy

import mdpo_rddl
from mdpo_rddl.errors import InputError
from mdpo_rddl.policy import relaxed_plans
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.policy.file import RULE_FORMAT, load_policy, save_policy
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.policy.lookahead.choice import PLANS, choose
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated, parse_rule, rule_text
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.relaxed_plans import RelaxedPlans
from mdpo_rddl.problem.delete_relaxation.distances import Prices
from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import open_model

LIMITS = EnumerationLimits(1e9)
CLAIM = Simulated(9.0, 0.5, 16)
RULE = PlanRule(0.5, 0.25, Prices(0.95, tries=True), samples=4)


@pytest.fixture(scope="module")
def problem():
    return courier()


@pytest.fixture(scope="module")
def policy(problem):
    return RelaxedPlanPolicy(problem, PlanRule(), CLAIM, seed=3)


def observation(place, holding):
    return {"at": np.arange(3) == place, "holding": np.array(holding)}


def played(policy, step, place, holding):
    actions = policy(step, observation(place, holding))
    return {name for name, value in actions.items() if np.any(value)}


def test_it_follows_the_chain(policy):
    assert played(policy, 0, 0, False) == {"pick"}
    assert played(policy, 1, 0, True) == {"go"}
    assert played(policy, 2, 1, True) == {"go"}
    assert played(policy, 3, 2, True) == {"hand-over"}
    # without the parcel there is nothing more to be had
    assert played(policy, 4, 2, False) == set()


def test_it_returns_what_is_best_on_the_exact_environment(problem, policy):
    evaluation = policy.evaluate(episodes=40, seed=1)
    optimum = find_optimum(problem, 30.0).value
    error = float(np.std(evaluation.returns)) / np.sqrt(40)
    assert evaluation.mean == pytest.approx(optimum, abs=4.0 * error + 0.01)
    assert evaluation.illegal_actions == 0


def test_both_pull_at_once():
    policy = RelaxedPlanPolicy(lift(), PlanRule(), CLAIM, seed=0)
    assert list(policy(0, {"up": False}).values()) == [True, True]
    assert list(policy(1, {"up": True}).values()) == [False, False]


def test_states_are_decided_alike_alone_and_side_by_side(problem):
    plans = RelaxedPlans(open_model(problem, LIMITS), LIMITS)
    states = np.array([[1, 0, 0, 0], [1, 0, 0, 1], [0, 0, 1, 1], [0, 1, 0, 0]]).T
    uniform = plans.uniform(0, 0, RULE)
    together = plans.decide(states, 0, RULE, uniform)
    alone = [plans.decide(states[:, [each]], 0, RULE, uniform)[:, 0] for each in range(4)]
    np.testing.assert_array_equal(together, np.array(alone).T)


def test_where_the_no_op_is_illegal_something_legal_is_played(problem):
    model = open_model(problem, LIMITS)
    graph, actions = model.graph, list(model.defaults())
    model = replace(model, legal=(*model.legal, graph.make("or", *actions)))
    plans = RelaxedPlans(model, LIMITS)
    # at the second place without the parcel, from where no reward can be had
    state = np.array([[0], [1], [0], [0]])
    decided = plans.decide(state, 0, PlanRule(), plans.uniform(0, 0, PlanRule()))
    assert plans.sampler.legal(state, decided).all()
    assert decided.any()


def test_what_must_be_done_by_all_at_once_is_found():
    model = open_model(lift(), LIMITS)
    graph, pulls = model.graph, list(model.defaults())
    # where nobody needs to pull, and no way to a reward is open
    model = replace(model, legal=(graph.make("and", *pulls),))
    plans = RelaxedPlans(model, LIMITS)
    up = np.array([[1]])
    assert plans.decide(up, 0, PlanRule(), plans.uniform(0, 0, PlanRule())).all()


def test_an_action_is_played_with_what_makes_it_legal(monkeypatch):
    # the target that was shot already must not hide the other one
    monkeypatch.setattr(relaxed_plans, "_MOST_GOALS", 1)
    policy = RelaxedPlanPolicy(camera(), PlanRule(), CLAIM, seed=0)
    action = policy(0, {"taken": np.array([True, False])})
    assert action["aim"]
    np.testing.assert_array_equal(action["shoot"], [False, True])
    done = policy(1, {"taken": np.array([True, True])})
    assert not done["aim"]
    assert not done["shoot"].any()


def test_what_helps_is_done_beside_what_must_be_done():
    model = open_model(camera(), LIMITS)
    # shooting does not read whether the camera is aimed, which is to be so at every step
    aim = model.graph.leaf(Kind.ACTION, ("aim", ()), True)
    plans = RelaxedPlans(replace(model, legal=(aim,)), LIMITS)
    state = np.array([[1], [0]])
    decided = plans.decide(state, 0, PlanRule(), plans.uniform(0, 0, PlanRule()))[:, 0]
    assert dict(zip(model.actions, decided, strict=True)) == {
        ("aim", ()): 1,
        ("shoot", (0,)): 0,
        ("shoot", (1,)): 1,
    }


def test_waiting_by_another_action_is_not_better_than_what_helps(problem):
    model = open_model(problem, LIMITS)
    legal = model.graph.make("or", *model.defaults())
    plans = RelaxedPlans(replace(model, legal=(*model.legal, legal)), LIMITS)
    # at the first place with the parcel: it could pick for ever, which costs nothing
    state = np.array([[1], [0], [0], [1]])
    go, pick, hand_over = plans.decide(state, 0, PlanRule(), plans.uniform(0, 0, PlanRule()))[:, 0]
    assert (go, pick, hand_over) == (1, 0, 0)


def test_who_is_patient_does_nothing_that_does_not_pay():
    # a go costs 1 and leads nowhere without the parcel
    problem = courier()
    plans = RelaxedPlans(open_model(problem, LIMITS), LIMITS)
    state = np.array([[0], [1], [0], [0]])
    decided = plans.decide(state, 0, PlanRule(patience=1.0), plans.uniform(0, 0, PlanRule()))
    assert not decided.any()


def test_what_stands_in_the_way_is_undone_where_the_way_is_searched_for():
    problem = tower()
    without, searching = (
        RelaxedPlanPolicy(problem, PlanRule(searches=each), CLAIM, 0).evaluate(episodes=1, seed=1)
        for each in (False, True)
    )
    assert without.mean == 0.0
    assert searching.mean == find_optimum(problem, 30.0).value == 3.0
    assert searching.illegal_actions == 0


def test_it_takes_ground_fluents_too(policy):
    ground = {"at___p0": False, "at___p1": True, "at___p2": False, "holding": True}
    assert policy(0, ground) == {"go": True, "pick": False, "hand-over": False}


def test_a_saved_policy_is_read_back(problem, policy, tmp_path):
    path = tmp_path / "plans"
    policy.save(path)
    saved = load_policy(path)
    assert read_container(path, [RULE_FORMAT])[1] == {}
    again = restored(saved, problem, str(path))
    assert isinstance(again, RelaxedPlanPolicy)
    assert (again.plan_rule, again.claim, again.seed) == (PlanRule(), CLAIM, 3)
    assert played(again, 0, 0, False) == {"pick"}
    # the file stands alone
    alone = mdpo_rddl.load_policy(path)
    assert alone.problem.digest == problem.digest
    assert alone.returns.tolist() == [9.0]
    assert alone.optimum is None


@pytest.mark.parametrize("searches", [False, True])
def test_a_rule_is_what_it_was_as_text(searches):
    rule = replace(RULE, searches=searches)
    assert parse_rule(rule_text(rule, CLAIM)) == (rule, CLAIM)


def test_a_rule_of_before_there_were_searches_has_none():
    figures = json.loads(rule_text(replace(RULE, searches=True), CLAIM)["plan_rule"])
    del figures["searches"]
    assert parse_rule({"plan_rule": json.dumps(figures)}) == (RULE, CLAIM)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("patience", 2.0),
        ("others", -0.1),
        ("decay", 1.0),
        ("tries", 1),
        ("searches", 0),
        ("value", float("nan")),
        ("error", -1.0),
        ("episodes", 0),
        ("episodes", True),
        ("samples", 0),
        ("samples", 2.0),
        ("samples", 2**30),
        ("patience", None),
    ],
)
def test_a_rule_that_was_changed_is_refused(policy, tmp_path, name, value):
    path = tmp_path / "plans"
    save_policy(path, policy.to_saved())
    metadata, tensors = read_container(path, [RULE_FORMAT])
    figures = json.loads(metadata["plan_rule"]) | {name: value}
    write_container(path, tensors, metadata | {"plan_rule": json.dumps(figures)})
    assert "damaged policy file" in one_line(lambda: load_policy(path))


def test_it_is_refused_for_another_problem(policy, tmp_path):
    said = one_line(lambda: restored(policy.to_saved(), toys.walk(tmp_path, 4), "a file"))
    assert said.startswith("a file: saved for")


def test_a_problem_without_a_ground_model_is_refused():
    with pytest.raises(InputError, match="no relaxed plans: the state is not observed"):
        RelaxedPlanPolicy(toy("tiger"), PlanRule(), CLAIM, 0)


def test_it_plans_at_each_decision_as_it_is(policy):
    assert policy.with_decision_seconds(0.5) is policy
    choice = choose(policy, 0.5)
    assert choice.policy is None
    assert choice.note == PLANS


def test_what_it_says_of_itself(policy):
    assert "RelaxedPlanPolicy" in repr(policy)
    assert "relaxed plans" in policy._repr_html_()
    assert str(policy.explain().note) == "the policy is a relaxed plan at each decision, not a rule"


def test_a_pickled_policy_plays_the_same(policy):
    again = pickle.loads(pickle.dumps(policy))
    assert (again.plan_rule, again.claim, again.seed) == (policy.plan_rule, policy.claim, 3)
    assert played(again, 0, 0, False) == {"pick"}


def test_what_is_no_step_or_no_observation_is_refused(policy):
    assert "got 1.5" in one_line(lambda: policy(1.5, observation(0, False)))
    assert "lacks" in one_line(lambda: policy(0, {"at": np.arange(3) == 0}))
