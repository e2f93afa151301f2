"""The entry `hindsight` of a summary."""

import logging

from mdpo_rddl.policy.hindsight.result import Hindsight
from mdpo_rddl.problem.hindsight.bound import Bounds
from mdpo_rddl.session.hindsight import HINDSIGHT_SECONDS, hindsight_figures
from mdpo_rddl.session.requests import Terms


class Asked:
    """A policy that keeps what it was asked, and a reporter."""

    def __init__(self, error=None):
        self.error, self.terms, self.stages = error, [], []

    def hindsight(self, episodes, seconds, seed):
        self.terms.append((episodes, seconds, seed))
        if self.error is not None:
            raise self.error
        return Hindsight(None, Bounds((), "a reason"))

    def stage(self, name):
        self.stages.append(name)


def test_the_first_episodes_are_asked_for():
    asked = Asked()
    figures = hindsight_figures(asked, Terms(None, 7, 100), asked)
    assert figures["hindsight"]["note"] == "a reason"
    hindsight_figures(asked, Terms(None, 7, 3), asked)
    assert asked.terms == [(10, HINDSIGHT_SECONDS, 7), (3, HINDSIGHT_SECONDS, 7)]
    assert asked.stages == ["hindsight", "hindsight"]


def test_a_mistake_costs_the_run_nothing(caplog):
    asked = Asked(MemoryError("too\nlarge"))
    with caplog.at_level(logging.WARNING):
        assert hindsight_figures(asked, Terms(None, 0, 1), asked) == {}
    assert "no hindsight: MemoryError: too" in caplog.text
