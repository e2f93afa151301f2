"""A problem that another process loads again is the same one, or none."""

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


def test_files_are_found_from_another_folder(tmp_path, monkeypatch):
    tiny_files(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    problem = load_problem("d.rddl", "i.rddl")
    source = sent(problem)
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert source.load().digest == problem.digest


def test_files_that_have_changed_are_refused(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    tiny_files(tmp_path, spread=1.0)
    message = one_line(sent(problem).load)
    assert message == f"{tmp_path / 'i.rddl'}: the problem's files have changed meanwhile"
