"""How large an iteration of `greedy` is, and what it takes at least."""

from types import SimpleNamespace

import pytest

from mdpo_rddl.auto.arena import learning_size
from mdpo_rddl.auto.arena.learning_size import is_too_long, learning_rollouts, least_seconds


def plan(tried: int, samples: int = 1) -> SimpleNamespace:
    return SimpleNamespace(tried=tried, rollout_samples=samples)


@pytest.mark.parametrize(
    ("tried", "samples", "rollouts"),
    [
        *((1, 1, 256), (8, 1, 256), (9, 1, 128), (32, 1, 64), (33, 1, 32), (4000, 1, 32)),
        *((1, 4, 128), (4, 4, 128), (5, 4, 64)),
    ],
)
def test_it_has_fewer_rollouts_where_a_decision_makes_many_steps(tried, samples, rollouts):
    assert learning_rollouts(plan(tried, samples)) == rollouts


@pytest.mark.parametrize(
    ("tried", "samples", "rollouts"), [(64, 1, 256), (65, 1, 64), (64, 4, 128), (65, 4, 32)]
)
def test_an_accelerator_makes_many_steps_at_once(monkeypatch, tried, samples, rollouts):
    monkeypatch.setattr(learning_size, "is_on_cpu", lambda: False)
    assert learning_rollouts(plan(tried, samples)) == rollouts


def test_an_iteration_may_take_a_fiftieth_of_the_race():
    assert not is_too_long(1.2, 60.0)
    assert is_too_long(1.21, 60.0)


def test_nothing_is_said_of_an_accelerator(monkeypatch):
    monkeypatch.setattr(learning_size, "is_on_cpu", lambda: False)
    assert least_seconds(plan(3), 2.0) == 0.0


def test_at_least_a_fifth_of_what_its_steps_take_in_other_rollouts():
    # 256 rollouts, of which each step is one of the no-op and three others; the judge has 128
    assert least_seconds(plan(3), 2.0) == pytest.approx(0.2 * 2.0 * 2.0 * 4.0)
    assert least_seconds(plan(3, samples=4), 2.0) == pytest.approx(0.2 * 2.0 * 4.0 * 4.0)
    assert least_seconds(plan(3), 0.0) == 0.0
