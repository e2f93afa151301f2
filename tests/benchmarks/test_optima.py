"""The measurement of proven optima: resumable, with a table."""

import pytest

from benchmarks.optima.optima import (
    Task,
    fully_observed_tasks,
    optima_table,
    read_published,
    run_optima,
)
from mdpo_rddl.errors import InputError

SMALL = ("TriangleTireworld_MDP_ippc2014", "1")
LARGE = ("GameOfLife_MDP_ippc2011", "9")


def tasks():
    return [Task(*name, seconds=20, memory_gb=4, episodes=5) for name in (SMALL, LARGE)]


def test_it_solves_and_gives_up_and_goes_on_where_it_was(tmp_path):
    records = run_optima(tmp_path, tasks())
    small, large = records.rows
    assert small["status"] == "optimum"
    assert float(small["optimum"]) == pytest.approx(93.12)
    assert large["status"] == "given up"
    before = (tmp_path / "rows.csv").read_text()
    assert run_optima(tmp_path, tasks()).rows == records.rows
    assert (tmp_path / "rows.csv").read_text() == before
    table = optima_table(records, {SMALL: 90.0})
    assert "Proven optimum: 1 of 2." in table
    assert "| 90 |" in table


def test_tasks_are_named_or_all_of_two_competitions():
    names = fully_observed_tasks(None, ["1"])
    assert SMALL in names
    assert all("POMDP" not in name for name, _ in names)
    with pytest.raises(InputError, match="no problem 'Nowhere'"):
        fully_observed_tasks(["Nowhere"], ["1"])


def test_published_returns_are_read(tmp_path):
    path = tmp_path / "published.csv"
    path.write_text("problem,instance,best\nA,1,-2.5\n")
    assert read_published(path) == {("A", "1"): -2.5}
    path.write_text("problem,instance\nA,1\n")
    with pytest.raises(InputError, match="no file of published returns"):
        read_published(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_published(tmp_path / "none.csv")
