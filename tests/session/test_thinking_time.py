"""How a run's time is shared between finding a policy and preparing to think."""

from pathlib import Path
from unittest.mock import create_autospec

import numpy as np
import pytest
from helpers.levers import lever_policy
from helpers.toys import toy

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.lookahead.choice import Choice
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.session import thinking
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.report.summary import return_figures
from mdpo_rddl.session.requests import PlanRequest, Reporter, Terms
from mdpo_rddl.session.thinking import choice_times, think, without_choice


def request(seconds, decision_seconds, problem=None):
    problem = problem or lever_policy().problem
    config = auto_preset("lever").with_values("Optimize", train_seconds=seconds)
    return PlanRequest(
        problem, config, "auto", 0, 2, Path("out"), decision_seconds=decision_seconds
    )


@pytest.mark.parametrize(
    ("seconds", "decision", "kept"),
    [(60.0, 0.0, 0.0), (60.0, 1.0, 15.0), (30.0, 1.0, 8.0), (10.0, 1.0, 5.0), (600.0, 1.0, 60.0)],
)
def test_preparing_to_think_is_within_the_runs_time(seconds, decision, kept):
    asked = request(seconds, decision)
    assert choice_times(asked) == (decision, kept)
    assert without_choice(asked).config.budget().seconds == seconds - kept
    assert asked.config.budget().seconds == seconds


def test_where_the_state_is_hidden_the_choice_has_more():
    assert choice_times(request(60.0, 1.0, toy("tiger"))) == (1.0, 24.0)


@pytest.mark.parametrize(("used", "within"), [(44.0, 16.0), (50.0, 15.0), (5.0, 55.0), (1.0, 59.0)])
def test_what_a_search_has_left_over_is_for_the_choice(used, within):
    assert choice_times(request(60.0, 1.0), used) == (1.0, within)


def test_the_choice_is_never_longer_than_it_may_be():
    assert choice_times(request(60.0, 0.5), used=1.0) == (0.5, 40.0)


@pytest.mark.parametrize(
    ("error", "said"),
    [(MemoryError("too large"), "MemoryError: too large"), (KeyboardInterrupt(), "stopped")],
)
def test_what_ends_the_preparation_costs_nothing_else(monkeypatch, caplog, error, said):
    def failing(policy, seconds, within):
        raise error

    monkeypatch.setattr(thinking, "choose", failing)
    policy = lever_policy()
    plain = Evaluation(np.array([1.0, 3.0]), np.array([2, 2]), 0, 0)
    terms = Terms(policy.problem, seed=0, episodes=2)
    figures = think(policy, plain, (1.0, 9.0), terms, create_autospec(Reporter))
    assert figures == return_figures(plain)
    assert f"no thinking: {said}" in caplog.text


def test_a_policy_that_cannot_be_used_to_think_is_refused(monkeypatch):
    def refusing(policy, seconds, within):
        raise InputError("its underlying policy is another problem's")

    monkeypatch.setattr(thinking, "choose", refusing)
    policy = lever_policy()
    plain, terms = Evaluation(np.zeros(2), np.ones(2), 0, 0), Terms(policy.problem, 0, 2)
    with pytest.raises(InputError, match="another problem's"):
        think(policy, plain, (1.0, 9.0), terms, create_autospec(Reporter))


def test_what_fails_while_it_thinks_leaves_what_was_observed(monkeypatch):
    def thinks(step, state):
        return {"pull": 1 // step}

    chosen = Choice(thinks, [], "", 0.0)
    monkeypatch.setattr(thinking, "choose", lambda policy, seconds, within: chosen)
    policy, reporter = lever_policy(), create_autospec(Reporter)
    terms = Terms(policy.problem, seed=0, episodes=2)
    observed = Observed(terms)
    plain = Evaluator(terms, reporter).run(policy, observed)
    before = observed.figures([0.0])["decision_times"]
    figures = think(policy, plain, (1.0, 9.0), terms, reporter, observed)
    assert figures == return_figures(plain)
    assert observed.figures([0.0])["decision_times"] == before
