"""What a race begins with, and which policies it refuses."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.problems import make_plan, make_planner
from helpers.races import CLOCK, means, raced
from helpers.toys import problem_from

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.probing import probing
from mdpo_rddl.auto.race import affording
from mdpo_rddl.auto.resuming.start import START, accepted_start, start_candidates
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.session.configuration import load_preset

TEXT = """
domain pushing {
    types { item : object; };
    pvariables {
        x(item) : { state-fluent, real, default = 1.0 };
        push(item) : { action-fluent, real, default = 0.0 };
    };
    cpfs { x'(?i) = x(?i) + push(?i); };
    reward = -(sum_{?i : item} [x(?i)]);
}
non-fluents nf { domain = pushing; objects { item : {OBJECTS}; }; }
instance one {
    domain = pushing; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 2; discount = 1.0;
}
"""


def policy_of(objects, plan=None):
    problem = problem_from(TEXT.replace("OBJECTS", objects))
    plan = plan or FeedbackPlan(FeedbackShape(topology=None, cosines=0, squares=False))
    planner = make_planner(MDPOPlanner, problem, plan)
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, planner.test_compiled.init_values)
    return Policy(problem, load_preset("auto", "pushing"), params, {}, 0, compiled=Compiled(planner))


@pytest.fixture(scope="module")
def two():
    return policy_of("a, b")


def arena_of(policy):
    """As much of an arena as a start asks for."""
    planner = policy.planner

    def candidate(arm, label, params):
        return Candidate(arm, label, policy.config, planner, params)

    plan, noop = planner.feedback_plan, policy.params
    return SimpleNamespace(problem=policy.problem, plan=plan, noop=noop, candidate=candidate)


def test_the_rule_of_another_instance_begins_in_the_arenas_own_planner(two, caplog):
    three = policy_of("a, b, c")
    own = {"push": {"bias": jnp.array([1.0, 3.0]), "gain on x": jnp.zeros(2)}}
    given = two.with_params({**two.params, "own": own})
    (candidate,) = start_candidates(arena_of(three), accepted_start(given, three.problem))
    assert candidate.planner is three.planner
    assert (candidate.arm, candidate.mean) == (START, None)
    names = three.planner.feedback_plan.feedback.names("push")
    np.testing.assert_array_equal(
        candidate.params["shared"]["push"], [2.0] + [0.0] * (len(names) - 1)
    )
    assert "push: what each object has of its own, but for its mean" in caplog.text
    assert start_candidates(arena_of(three), None) == []


def test_what_only_its_own_planner_can_play_begins_there_too(two):
    shape = FeedbackShape(topology=None, cosines=0, squares=False, lifted=2)
    given = policy_of("a, b", FeedbackPlan(shape))
    for layer in given.params["lifted"].values():
        layer["output"] = np.ones_like(layer["output"])
    rule, own = start_candidates(arena_of(two), accepted_start(given, two.problem))
    assert rule.planner is two.planner
    assert own.planner is given.planner
    assert own.params is given.params
    # where the arena's planner has the layer, one candidate does
    assert len(start_candidates(arena_of(given), given)) == 1
    assert len(start_candidates(arena_of(policy_of("a, b, c")), given)) == 1


def test_a_policy_of_another_kind_keeps_its_planner_on_its_own_problem(two):
    given = policy_of("a, b", make_plan("slp"))
    (candidate,) = start_candidates(arena_of(two), accepted_start(given, two.problem))
    assert candidate.planner is given.planner
    assert candidate.params is given.params


def test_what_cannot_begin_is_told_in_a_line(two):
    three = policy_of("a, b, c", make_plan("slp"))
    said = one_line(lambda: accepted_start(three, two.problem))
    assert said.endswith("that is no lifted rule: it fits its own instance only")
    other = replace(two.problem, domain_name="pulling")
    said = one_line(lambda: accepted_start(two, other))
    assert said == "cannot start from a policy of the domain 'pushing': it is not 'pulling'"
    table = SimpleNamespace(problem=two.problem)
    assert one_line(lambda: accepted_start(table, two.problem)).startswith(
        "cannot start from a table"
    )


@pytest.fixture
def large(lake, monkeypatch):
    """A problem for which a search would take too long, and what it is given."""
    monkeypatch.setattr(probing, "is_large", lambda planner: True)
    monkeypatch.setattr(affording, "_FEWEST_POLICIES", 10**9)
    return lake, lambda arena: [arena.candidate(START, START, arena.noop)]


@pytest.mark.usefixtures("one_core")
def test_where_a_problem_is_too_large_to_search_what_was_given_is_judged(large):
    problem, given = large
    outcome = raced(problem, 300.0, RaceOptions(clock=CLOCK, initial=given))
    found = means(outcome)
    # by more rollouts than the probing has made of it
    assert found[START] == pytest.approx(outcome.probe.noop_return, rel=0.1)
    assert outcome.chosen.mean == max(found.values())


@pytest.mark.usefixtures("one_core", "failing_race")
def test_what_cannot_be_judged_in_time_ends_no_race(large, monkeypatch, caplog):
    def late(*arguments):
        raise TooLateError("the judge's rollouts")

    problem, given = large
    monkeypatch.setattr(Judge, "returns_of", late)
    outcome = raced(problem, 300.0, RaceOptions(clock=CLOCK, initial=given))
    assert "best policy so far is kept: the judge's rollouts" in caplog.text
    assert outcome.chosen.label == "constant"
    assert not outcome.interrupted
