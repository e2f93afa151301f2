"""The problems that come with the package, by their names."""

import pytest
from helpers.mistakes import one_line
from helpers.problems import ROOT

from mdpo_rddl.problem import shipped
from mdpo_rddl.problem.files import list_problems, read_problem
from mdpo_rddl.problem.shipped import shipped_files, shipped_names


def test_the_names_are_those_of_the_files_of_record():
    assert shipped_names() == sorted(path.stem for path in (ROOT / "instances").iterdir())
    for name in shipped_names():
        domain, instance = shipped_files(name)
        assert domain.parent == ROOT / "domains"
        assert instance == ROOT / "instances" / f"{name}.rddl"
        assert read_problem(name).is_own


def test_a_copy_in_the_package_goes_first(tmp_path, monkeypatch):
    for folder, name in (("domains", "lake"), ("instances", "lake2")):
        (tmp_path / "shipped" / folder).mkdir(parents=True)
        (tmp_path / "shipped" / folder / f"{name}.rddl").write_text(name)
    monkeypatch.setattr(shipped, "_PACKAGE", tmp_path)
    assert shipped_names() == ["lake2"]
    files = read_problem("lake2")
    assert (files.domain_text, files.instance_text, files.label) == ("lake", "lake2", "lake2")


def test_a_name_finds_its_files_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    by_name = read_problem("reservoir15")
    by_files = read_problem(*map(str, shipped_files("reservoir15")))
    assert by_name == by_files


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("hvac01",), "there is no problem 'hvac01'; did you mean hvac20 or hvac10"),
        (("qqqqqq",), "there is no problem 'qqqqqq' (mdpo-plan --list shows all)"),
        (("HVAC_ippc2023",), "which instance of 'HVAC_ippc2023'? It has: 0 1 2 3 4 5"),
        (("tanks.rddl",), "tanks.rddl: cannot read the domain file"),
        (("hvac10", "4"), "'hvac10' is a problem by itself: leave '4' out"),
        (("HVAC_ipc2023", "4"), "did you mean HVAC_ippc2023"),
    ],
)
def test_a_wrong_name_is_answered_by_near_ones(arguments, said):
    assert said in one_line(lambda: read_problem(*arguments))
    assert "no shipped problem" in one_line(lambda: shipped_files("lake2"))


def test_the_list_has_every_problem_and_its_instances():
    lines = list_problems()
    assert lines[: len(shipped_names())] == shipped_names()
    assert "Reservoir_ippc2023 1|2|3|4|5" in lines
    assert len(lines) > 80
