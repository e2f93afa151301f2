"""Operators of the linear program where an episode's numbers are known."""

import warnings

import pytest

from mdpo_rddl.problem.hindsight.operators import applied
from mdpo_rddl.problem.hindsight.program import Affine, NotLinearError, Program


def test_a_division_by_a_known_zero_may_be_of_the_branch_that_is_not_taken():
    program = Program()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert applied(program, "/", (1.0, 0.0)) == float("inf")
    with pytest.raises(NotLinearError, match="division by 0"):
        applied(program, "/", (Affine(0.0, {0: 1.0}), 0.0))
