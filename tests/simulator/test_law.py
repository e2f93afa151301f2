"""The simulator and pyRDDLGym's environment, step by step on all problems of rddlrepository."""

import pytest

from benchmarks.problems.simulator_law import compare, every_problem, law_table
from mdpo_rddl.problem.load import load_problem


@pytest.mark.parametrize(("name", "instance"), list(every_problem()))
def test_a_problem_obeys_the_environments_law(name, instance):
    found = compare(load_problem(name, instance), 0.5, is_random=True)
    assert found.differences == []
    assert found.steps > 0


def test_the_table_tells_what_is_equal_and_what_differs():
    rows = [
        {"problem": "A", "instance": "1", "steps": "9", "draws": "True", "rounding": "0"},
        {"problem": "B", "instance": "1", "steps": "9", "draws": "False", "rounding": "1e-16"},
        {"problem": "C", "instance": "1", "steps": "9", "draws": "False", "rounding": "1"},
    ]
    differences = ["", "", "reward at step 3 by 1"]
    for row, each in zip(rows, differences, strict=True):
        row |= {"mean": "", "standard_errors": "0", "differences": each}
    table = law_table(rows)
    assert "Of 3 problems 1 are equal to the last bit, and 2 but for rounding" in table
    assert "| C | 1 | 9 | False | 1 |  | reward at step 3 by 1 |" in table
