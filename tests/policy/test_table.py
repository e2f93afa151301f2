"""The table of actions: played, saved, read back."""

import numpy as np
import pytest
from helpers import toy_mdps as toys

from mdpo_rddl.auto.optimum import find_optimum
from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.table import TablePolicy, load_table, save_table


@pytest.fixture
def solved(tmp_path):
    problem = toys.walk(tmp_path, 4)
    return problem, find_optimum(problem, 30).table


def observation(cell, sky):
    return {"at": np.arange(3) == cell, "sky": np.array([sky])}


def test_it_goes_where_it_is_dry(solved):
    policy = TablePolicy(solved[1])
    assert policy(0, observation(0, "dry"))["go"] is True
    assert policy(1, observation(1, "dry"))["go"] is True
    assert policy(1, observation(1, "wet"))["go"] is False
    assert policy(1, observation(1, 1))["go"] is False
    assert not policy(0, observation(0, "dry"))["dance"].any()
    assert policy.misses == 0


def test_the_action_changes_with_the_steps_left(tmp_path):
    # with one step left a press costs and comes too late
    policy = find_optimum(toys.lamp(tmp_path, 3), 30).policy()
    dark = {"on": np.array([False])}
    assert [policy(step, dark)["press"] for step in range(3)] == [True, True, False]


def test_an_unknown_state_gets_the_no_op_and_is_counted(solved):
    policy = TablePolicy(solved[1])
    nowhere = {"at": np.zeros(3, bool), "sky": np.array(["dry"])}
    assert policy(0, nowhere)["go"] is False
    assert policy.misses == 1


def test_a_saved_table_is_read_back(solved, tmp_path):
    problem, table = solved
    save_table(tmp_path / "table", table, problem.digest)
    again = load_table(tmp_path / "table", problem.digest)
    for name in ("places", "merges", "states", "first_run", "until_step", "action"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))
    assert again.fluents == table.fluents
    assert again.objects == table.objects
    for step in range(4):
        for sky in ("dry", "wet"):
            seen = observation(min(step, 1), sky)
            mine, yours = TablePolicy(table)(step, seen), TablePolicy(again)(step, seen)
            assert mine["go"] == yours["go"]


def test_a_bad_file_is_refused_in_one_line(solved, tmp_path):
    problem, table = solved
    path = tmp_path / "table"
    with pytest.raises(InputError, match="no such table"):
        load_table(path, problem.digest)
    path.write_bytes(b"nonsense")
    with pytest.raises(InputError, match="damaged table"):
        load_table(path, problem.digest)
    save_table(path, table, "other")
    with pytest.raises(InputError, match="of another problem"):
        load_table(path, problem.digest)
