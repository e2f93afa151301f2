"""The rule in words, in a run's summary."""

from types import SimpleNamespace
from unittest.mock import create_autospec

import pytest

from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.session import plan


@pytest.mark.parametrize("is_quick", [True, False])
def test_a_rule_that_cannot_be_written_costs_nothing_else(caplog, monkeypatch, is_quick):
    monkeypatch.setattr(plan, "is_compiled", lambda planner: False)
    policy = create_autospec(Policy, instance=True, planner=None)
    policy.explain.side_effect = ValueError("need at least\none array")
    observed = SimpleNamespace(episode_seconds=0.0 if is_quick else 1e3)
    assert plan._rule(policy, observed, was_played=True, in_haste=False) is None
    assert caplog.messages == ["no rule: ValueError: need at least one array"] * is_quick


@pytest.mark.parametrize("compiled", [True, False])
def test_a_run_that_was_stopped_compiles_nothing_for_its_rule(monkeypatch, compiled):
    monkeypatch.setattr(plan, "is_compiled", lambda planner: compiled)
    policy = create_autospec(Policy, instance=True, planner=None)
    policy.explain.return_value = SimpleNamespace(equations=[1], to_json=lambda: {"note": "words"})
    observed = SimpleNamespace(episode_seconds=0.0)
    found = plan._rule(policy, observed, was_played=True, in_haste=True)
    assert found == ({"note": "words"} if compiled else None)
    assert policy.explain.called == compiled
