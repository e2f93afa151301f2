"""rddlrepository where its list of problems cannot be written or read."""

import pytest
from rddlrepository.core import manager

from mdpo_rddl.problem.repository import rddl_repository


@pytest.fixture
def afresh():
    rddl_repository.cache_clear()
    yield
    rddl_repository.cache_clear()


@pytest.mark.usefixtures("afresh")
def test_a_folder_of_somebody_else_s(monkeypatch):
    known = sorted(rddl_repository().list_problems())
    # there is no such folder to write to
    monkeypatch.setattr(manager, "manifest", "none/manifest.csv")
    rddl_repository.cache_clear()
    assert sorted(rddl_repository().list_problems()) == known
    problem = rddl_repository().get_problem("HVAC_ippc2023")
    assert "1" in problem.list_instances()


@pytest.mark.usefixtures("afresh")
def test_a_list_that_is_half_written(monkeypatch, tmp_path):
    (tmp_path / "manifest.csv").write_text("name,description,location\nHVAC\n")
    monkeypatch.setattr(manager, "manifest", str(tmp_path / "manifest.csv"))
    assert "HVAC_ippc2023" in rddl_repository().list_problems()
