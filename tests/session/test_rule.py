"""The rule in words, in a run's summary."""

from types import SimpleNamespace
from unittest.mock import create_autospec

import pytest

from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.session import plan


@pytest.mark.parametrize("is_quick", [True, False])
def test_a_rule_that_cannot_be_written_costs_nothing_else(caplog, is_quick):
    policy = create_autospec(Policy, instance=True)
    policy.explain.side_effect = ValueError("need at least\none array")
    assert plan._rule(policy, SimpleNamespace(is_quick=is_quick)) is None
    assert caplog.messages == ["no rule: ValueError: need at least one array"] * is_quick


def test_a_rule_is_in_the_summary_as_json_can_hold_it():
    policy = create_autospec(Policy, instance=True)
    policy.explain.return_value = SimpleNamespace(equations=[1], to_json=lambda: {"note": "words"})
    assert plan._rule(policy, SimpleNamespace(is_quick=True)) == {"note": "words"}
