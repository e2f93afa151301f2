"""The race of the preset `auto` on problems that compile fast, by a clock that does not wait."""

import json
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.lakes import PLAIN, preset
from helpers.races import CLOCK, means, means_of, raced
from helpers.toys import toy

from mdpo_rddl import evaluate, make_environment
from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms import compiling, gradient, shared_weights, simple
from mdpo_rddl.auto.common import sizes
from mdpo_rddl.auto.probing import probing
from mdpo_rddl.auto.race import affording, race, schedule
from mdpo_rddl.auto.race.schedule import Schedule
from mdpo_rddl.auto.search import plan_population, population

pytestmark = pytest.mark.usefixtures("one_core")
NOOP, CONSTANT = "no-op", "constant"


def refuse(*arguments):
    raise AssertionError("asked for")


def arm(outcome, name: str) -> dict:
    return arms_of(outcome)[name]


def arms_of(outcome) -> dict[str, dict]:
    return outcome.diagnostics()["arms"]


def phases_of(outcome) -> list[dict]:
    return arm(outcome, "gradient")["phases"]


@pytest.fixture(scope="module")
def outcome(lake):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(affording, "usable_cores", lambda: 1)
        return raced(lake, 2000.0)


@pytest.mark.long
def test_every_part_of_the_race_improves_on_what_it_begins_with(outcome):
    found = means(outcome)
    # 300 below at all 8 steps; a constant halves it
    assert found[NOOP] == pytest.approx(-2400.0, rel=0.05)
    assert found[CONSTANT] > -1500.0
    # feedback does better, and the chance that is left costs about 8 x 20
    assert found["shared weights"] > max(found[CONSTANT], found["random rule"]) + 50.0
    assert found["shared weights"] > -700.0
    assert outcome.chosen.mean == max(found.values())
    assert outcome.chosen.mean >= found["shared weights"]
    assert arm(outcome, "shared weights")["iterations"] > 50


@pytest.mark.long
def test_the_gradient_alone_improves_on_the_best_constant(lake, in_one_arena):
    # searches end at once
    outcome = raced(lake, 2500.0, shared_until=0.001, own_until=0.001, rounds_until=0.95)
    labels = [judged.candidate.label for judged in outcome.judged]
    first = next(place for place, label in enumerate(labels) if label.startswith("phase 1"))
    start = max(judged.candidate.mean for judged in outcome.judged[:first])
    phases = [name for name in labels if name.startswith("phase 1")]
    assert start >= means(outcome)[CONSTANT]
    assert max(means(outcome)[name] for name in phases) > start
    assert phases_of(outcome)[0]["improved"]
    assert arm(outcome, "gradient")["iterations"] == 60 * len(phases_of(outcome))
    assert outcome.chosen.uses_noise
    assert "gradient" in (outcome.chosen.arm, *outcome.chosen.parents)
    assert outcome.policy.config.section("Noise")["method"] == "AdaptiveNoise"
    log = outcome.noise_log
    assert log.sigma.shape == (len(log.records), 8)
    assert [record.iteration for record in log.records] == sorted(
        {record.iteration for record in log.records}
    )


@pytest.mark.long
def test_the_outcome_says_what_each_arm_was_given_and_found(outcome):
    diagnostics = outcome.diagnostics()
    json.dumps(diagnostics, allow_nan=False)
    assert diagnostics["chosen"] == outcome.chosen.label
    assert diagnostics["arm"] == outcome.chosen.arm
    # by the judge, in as many rollouts as all others
    assert diagnostics["noop_return"] == means(outcome)[NOOP] != outcome.probe.noop_return
    assert diagnostics["random_return"] < means(outcome)[CONSTANT]
    names = ["constants and rules", "shared weights", "plan"]
    assert list(diagnostics["arms"])[:3] == names
    for name, log in diagnostics["arms"].items():
        best = max(c["mean_return"] for c in diagnostics["candidates"] if c["arm"] == name)
        assert log["best_return"] == best
        assert log["slices"] >= 1
        assert 0.0 < log["seconds"] <= outcome.seconds
    seconds = [judged.seconds for judged in outcome.judged]
    assert seconds == sorted(seconds)
    incumbents = [j.candidate.mean for j in outcome.judged if j.became_incumbent]
    assert incumbents == sorted(incumbents)
    assert incumbents[-1] == outcome.chosen.mean
    assert "Search" not in outcome.policy.config.sections
    assert 0.0 <= outcome.compile_seconds <= outcome.seconds
    assert not outcome.interrupted


@pytest.mark.long
def test_the_policy_is_the_chosen_candidate(outcome, lake):
    played = evaluate(make_environment(lake), outcome.policy, episodes=40, seed=0)
    error = played.std / np.sqrt(40)
    assert played.mean == pytest.approx(outcome.chosen.mean, abs=5.0 * error)


def test_without_a_gradient_the_search_has_to_do(lake, in_one_arena, no_gradient, caplog):
    outcome = raced(lake, 600.0)
    assert phases_of(outcome) == []
    assert "this model has no gradient" in caplog.text
    assert outcome.chosen.mean > means(outcome)[CONSTANT]
    # it has seen no noise, and says so
    assert outcome.noise_log is None
    assert outcome.policy.config.section("Noise") == {"method": "NoNoise"}


@pytest.mark.long
def test_where_nothing_beats_the_no_op_it_explores(corridor, monkeypatch):
    # of very many rules one may
    monkeypatch.setitem(simple._COUNTS, simple.Rules.MANY, 512)
    outcome = raced(corridor, 3000.0)
    found = means(outcome)
    assert found[CONSTANT] <= 0.0
    assert found["plan"] > 90.0
    assert outcome.chosen.label in {"plan", "polished"}
    assert arm(outcome, "exploration")["iterations"] > 10
    assert arm(outcome, "exploration")["cells"] > 3
    # a rule is not needed once a plan's return does not depend on chance
    assert "shared weights" not in outcome.diagnostics()["arms"]
    assert outcome.diagnostics()["parents"] == (
        [] if outcome.chosen.label == "plan" else ["exploration"]
    )


@pytest.mark.parametrize(
    ("label", "paid", "is_rare"),
    [("random rule", 0.001, True), ("random rule", 0.1, False), (CONSTANT, 0.001, False)],
)
def test_a_reward_is_rare_where_few_rules_alone_find_it(monkeypatch, label, paid, is_rare):
    monkeypatch.setattr(Schedule, "_finds_reward", lambda self: True)
    monkeypatch.setattr(Schedule, "_best", SimpleNamespace(label=label))
    rules = SimpleNamespace(paid_share=paid)
    assert Schedule.__new__(Schedule)._is_reward_rare(rules) == is_rare


def test_where_exploring_finds_nothing_feedback_is_tried(corridor, monkeypatch):
    monkeypatch.setattr(
        "mdpo_rddl.auto.search.plan_population.PlanPopulation.evolved",
        lambda self, params, goal, archive=None: params,
    )
    # a random rule that has all weights would find the reward
    starts = shared_weights._Start.RULE, shared_weights._Start.NOOP
    monkeypatch.setattr(shared_weights, "_STARTS", starts)
    outcome = raced(corridor, 300.0)
    assert {"plan", "shared weights", "polished"} <= set(means(outcome))
    assert arm(outcome, "exploration")["slices"] > 1


def test_where_plans_are_too_large_there_is_none(lake, no_gradient, monkeypatch):
    monkeypatch.setattr(sizes, "_PLANS_BYTES", 8 * 4 * sizes.PLANS - 1)
    outcome = raced(lake, 300.0)
    assert "plan" not in outcome.diagnostics()["arms"]
    assert outcome.random_return is None
    assert outcome.policy.config.section("Planner")["method_kwargs"]["plan"] is False
    assert "own weights" in means(outcome)


def test_where_chance_plays_a_part_own_weights_have_their_turn_beside_a_plan_that_leads(
    lake, no_gradient, monkeypatch
):
    def lead(self, *_):
        self._has_plan = True

    monkeypatch.setattr(Schedule, "_search_plans", lead)
    outcome = raced(lake, 300.0)
    assert "own weights" in means(outcome)
    # they are better, and so what is polished is not the plan
    assert "polishing the weights" in arms_of(outcome)


def test_own_weights_have_their_time_beside_the_compilation_of_plans(
    lake, no_gradient, monkeypatch
):
    compiling, ends = 40.0, {}
    monkeypatch.setattr(plan_population.PlanPopulation, "compile_seconds", compiling)
    give = Schedule.give

    def note(self, arm, until):
        ends.setdefault(arm.name, until)
        give(self, arm, until)

    monkeypatch.setattr(Schedule, "give", note)
    # half of the time between the shared weights and the end is the plan's
    raced(lake, 300.0, shared_until=0.2, own_until=0.3)
    second_half = ends["own weights"] - ends["plan"]
    assert second_half == pytest.approx(compiling + ends["plan"] - ends["shared weights"], rel=0.2)


@pytest.mark.parametrize(("name", "pairs"), [("lake", 100), ("corridor", 0)])
def test_gains_of_pairs_are_for_problems_with_chance(name, pairs, request):
    problem, options = request.getfixturevalue(name), RaceOptions(clock=CLOCK)
    arena = race._arena(problem, preset(300.0), 0, CLOCK(), options)
    assert arena.config.policy_arguments["pairs"] == pairs


@pytest.mark.long
@pytest.mark.parametrize("takes_part", [True, False])
def test_where_plans_lead_the_searches_begin_in_the_rounds(takes_part):
    left_out = [] if takes_part else ["shooting"]
    options = RaceOptions(clock=CLOCK, most_iterations=2000)
    boats = toy("boats", TERMINATION="false")
    outcome = raced(boats, 900.0, options, without=[*PLAIN, *left_out])
    arms = list(outcome.diagnostics()["arms"])
    assert ("shooting" in arms) == takes_part
    # what follows the same gradient is not compiled, and what else finds plans is not needed
    assert {"plan", "gradient"}.isdisjoint(arms) is takes_part
    assert "shared weights" in arms
    assert ("random rule" in means(outcome)) is not takes_part
    if takes_part:
        assert arms.index("shooting") < arms.index("shared weights")
        assert outcome.chosen.arm == "shooting"
        assert outcome.chosen.mean == pytest.approx(-2.75, abs=0.01)


@pytest.mark.long
def test_where_plans_lead_and_others_take_long_to_compile_they_have_all_the_time(monkeypatch):
    asked = affording.Affording
    monkeypatch.setattr(asked, "population", lambda self, share=1.0: share == 1.0)
    outcome = raced(toy("boats", TERMINATION="false"), 900.0, RaceOptions(clock=CLOCK))
    searched = {"constants and rules", "shooting"}
    assert {name for name, log in arms_of(outcome).items() if log["seconds"]} == searched


def test_a_compilation_that_takes_too_long_keeps_nobody_waiting(lake, in_one_arena, monkeypatch):
    released = threading.Event()
    monkeypatch.setattr(gradient.Training, "compile", lambda training: released.wait(120.0))
    # with a second core nobody waits
    monkeypatch.setattr(affording, "usable_cores", lambda: 2)
    try:
        outcome = raced(lake, 600.0)
    finally:
        released.set()
    assert phases_of(outcome) == []
    assert arm(outcome, "gradient")["slices"] == 0
    assert arm(outcome, "polishing the weights")["slices"] > 1
    assert means(outcome)["polished"] > means(outcome)[NOOP]


def test_where_the_deadline_would_meet_every_program_policies_are_played_one_by_one(
    lake, caplog, monkeypatch
):
    caplog.set_level("INFO")
    # the judge's program took longer than what is left
    monkeypatch.setattr(Judge, "usual_seconds", 1e9)
    monkeypatch.setattr(affording.Affording, "others", lambda self, share: True)
    monkeypatch.setattr(population, "_compiled", refuse)
    monkeypatch.setattr(compiling.CompilingArm, "begin", refuse)
    outcome = raced(lake, 600.0)
    assert "one by one" in caplog.text
    assert set(arms_of(outcome)) <= {
        *("constants and rules", "shared weights", "own weights", "polishing the weights")
    }
    assert means(outcome)["shared weights"] > means(outcome)[CONSTANT]


def test_once_the_race_is_over_no_arm_is_given_anything(lake, in_one_arena):
    arena = race._arena(lake, preset(5.0), 0, CLOCK() - 1000.0, RaceOptions(clock=CLOCK))
    late = schedule.Schedule(arena, race._shares(preset(5.0)), lambda name: None)
    late.run()
    assert list(means_of(arena.judge)) == [NOOP, CONSTANT]
    assert CLOCK() > arena.deadline
    # the second process may be waited for a little longer
    assert not late.give(schedule.SharedWeightsArm(arena, NOOP), arena.deadline)
    assert [arm.name for arm in late.arms] == ["constants and rules"]


def test_too_little_time_for_the_gradient_is_said(lake, in_one_arena, caplog, monkeypatch):
    # it needs time for so many of a search's iterations
    monkeypatch.setattr(affording, "_EVALUATIONS", 1000.0)
    outcome = raced(lake, 300.0, own_until=0.84)
    assert "too little time for the gradient" in caplog.text
    assert "gradient" not in outcome.diagnostics()["arms"]


def test_a_problem_too_large_to_search_gets_the_best_constant(lake, monkeypatch):
    monkeypatch.setattr(probing, "is_large", lambda planner: True)
    monkeypatch.setattr(affording, "_FEWEST_POLICIES", 10**9)
    outcome = raced(lake, 300.0)
    assert outcome.chosen.label == CONSTANT
    assert outcome.arms == []
    assert outcome.chosen.mean >= outcome.probe.noop_return
