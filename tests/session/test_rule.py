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
    assert plan._rule(policy, observed, True) is None
    assert caplog.messages == ["no rule: ValueError: need at least one array"] * is_quick
