"""A problem that another process loads again is the same one, or none."""

import dataclasses
import json
from dataclasses import asdict

import pytest
from helpers.mistakes import one_line
from helpers.problems import tiny_files

from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.problem.source import ProblemSource


def sent(problem):
    """Its source on the other side of a line of JSON."""
    return ProblemSource(**json.loads(json.dumps(asdict(ProblemSource.of(problem)))))


# the second pair of files disagrees in the domain's name
@pytest.mark.parametrize("names", [("MountainCar_ippc2023", "1"), ("Bicycle_physics", "0")])
def test_it_is_the_same(names):
    problem = load_problem(*names, horizon=7)
    again = sent(problem).load()
    for name in ("domain_name", "instance_name", "label", "horizon", "digest"):
        assert getattr(again, name) == getattr(problem, name)
    assert again.model.cpfs.keys() == problem.model.cpfs.keys()


def test_the_files_are_not_needed_any_more(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    source = sent(problem)
    tiny_files(tmp_path, spread=1.0)
    assert source.load().digest == problem.digest
    (tmp_path / "d.rddl").unlink()
    again = source.load()
    assert again.domain_text == problem.domain_text
    assert again.instance_path == problem.instance_path


def test_a_mistake_in_the_text_names_the_file(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    source = dataclasses.replace(sent(problem), domain_text="domain tiny {")
    assert one_line(source.load).startswith(f"{tmp_path / 'd.rddl'}:1: syntax error")
