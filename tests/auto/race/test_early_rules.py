"""Rules before anything but the probing's program is compiled."""

from types import SimpleNamespace

import pytest
from helpers.clocks import Stopped

from mdpo_rddl.auto.race.early_rules import EARLY_RULE, EarlyRulesArm


class Probed:
    """Has one rule, which is found at once; or raises an error."""

    def __init__(self, mean, error=None):
        self.mean, self.error, self.ends = mean, error, []

    def has_time(self, until, clock):
        return True

    def best_rule(self, named, seed, until, clock):
        self.ends.append(until)
        if self.error is not None:
            raise self.error
        return SimpleNamespace(label=named[1], known_mean=self.mean, error=0.3)


def arena(probed, seconds=60.0, raises=False):
    """The best constant returns 2."""
    return SimpleNamespace(
        clock=Stopped(),
        deadline=seconds,
        seed=3,
        probe=SimpleNamespace(noop_return=1.0, start_return=2.0),
        problem=SimpleNamespace(raises=raises),
        probed=probed,
    )


def labels(arm):
    arm.play()
    return [one.label for one in arm.take_candidates()]


@pytest.mark.parametrize(("mean", "is_offered"), [(2.4, True), (2.2, False), (0.5, False)])
def test_one_is_offered_if_it_returns_more_than_the_constants(mean, is_offered):
    assert labels(EarlyRulesArm(arena(Probed(mean)))) == [EARLY_RULE] * is_offered


@pytest.mark.parametrize(("seconds", "until"), [(60.0, 1.8), (10.0, 0.5), (600.0, 5.0)])
def test_they_take_a_small_share_of_the_time(seconds, until):
    probed = Probed(2.4)
    EarlyRulesArm(arena(probed, seconds)).play()
    assert probed.ends == [pytest.approx(until)]


@pytest.mark.parametrize(
    ("probed", "raises"),
    [(None, False), (Probed(2.4), True), (Probed(2.4, FloatingPointError("overflow")), False)],
)
def test_the_race_goes_on_without_them(probed, raises):
    assert labels(EarlyRulesArm(arena(probed, raises=raises))) == []
