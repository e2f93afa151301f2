"""A policy that the exact environment pays less than the judge's rollouts did."""

from dataclasses import replace

import numpy as np
import pytest

from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.session.confirmation import less_than_judged

JUDGED = Candidate(
    "own weights",
    "own weights",
    config=None,
    planner=None,
    params={},
    mean=100.0,
    error=1.0,
    returns=np.full(128, 100.0),
)


def played(*returns):
    return Evaluation(np.array(returns), np.ones(len(returns), int), 0, 0)


@pytest.mark.parametrize(
    ("returns", "is_less"),
    [
        ((94.0, 94.0, 94.0), True),  # 4 errors of 1, and a hundredth
        ((95.5, 95.5, 95.5), False),
        ((94.0, 80.0, 108.0), False),  # its own error is 8.1
        ((-300.0, -310.0), True),
        ((130.0, 130.0), False),
        ((0.0,), False),
    ],
)
def test_less_than_the_errors_allow_is_told(returns, is_less):
    said = less_than_judged(JUDGED, played(*returns))
    assert bool(said) == is_less
    assert ("100: the policy may sit on a threshold" in said) == is_less


def test_nothing_is_said_of_what_no_rollouts_were_made_of():
    assert less_than_judged(replace(JUDGED, returns=None), played(0.0, 0.0)) == ""
    assert less_than_judged(replace(JUDGED, returns=None, mean=None), played(0.0, 0.0)) == ""
