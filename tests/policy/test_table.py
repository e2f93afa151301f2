"""The table of actions: played, saved, read back, refused."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.mistakes import one_line
from helpers.toys import problem_from

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.policy.file import (
    ESTIMATE_FORMAT,
    TABLE_FORMAT,
    load_parameters,
    load_policy,
    save_policy,
)
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.policy.lookahead.choice import RAISES, choose
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.table import Estimate, parse_table, table_tensors, table_text
from mdpo_rddl.policy.table_policy import TablePolicy


@pytest.fixture
def policy(tmp_path):
    return find_optimum(toys.walk(tmp_path, 4), 30).policy(seed=5)


def observation(cell, sky):
    return {"at": np.arange(3) == cell, "sky": np.array([sky])}


def test_it_goes_where_it_is_dry(policy):
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


def test_an_unknown_state_gets_the_no_op_and_is_counted(policy):
    nowhere = {"at": np.zeros(3, bool), "sky": np.array(["dry"])}
    assert policy(0, nowhere)["go"] is False
    assert policy.misses == 1


def test_a_saved_table_is_read_back(policy, tmp_path):
    path = tmp_path / "table"
    save_policy(path, policy.to_saved())
    again = restored(load_policy(path), policy.problem, str(path))
    assert isinstance(again, TablePolicy)
    for name, tensor in table_tensors(policy.table).items():
        np.testing.assert_array_equal(table_tensors(again.table)[name], tensor, strict=True)
    assert again.table.fluents == policy.table.fluents
    assert again.table.objects == policy.table.objects
    assert again.optimum == replace(policy.optimum, seconds=None)
    assert again.seed == 5
    for step in range(4):
        for sky in ("dry", "wet"):
            seen = observation(min(step, 1), sky)
            assert again(step, seen)["go"] == policy(step, seen)["go"]


def test_for_another_horizon_nothing_is_proven(policy, tmp_path):
    path = tmp_path / "table"
    save_policy(path, policy.to_saved())
    longer = toys.walk(tmp_path, 6)
    again = restored(load_policy(path), replace(longer, digest=policy.problem.digest), str(path))
    assert (again.problem.horizon, again.made_for, again.optimum) == (6, 4, None)
    assert again.to_saved().problem["horizon"] == 4


def test_an_action_may_be_changed_by_whoever_gets_it(policy):
    wet = observation(1, "wet")
    policy(1, wet)["dance"][:] = True
    assert not policy(1, wet)["dance"].any()


def test_the_values_of_the_states_are_read_back(tmp_path):
    policy = find_optimum(toys.walk(tmp_path, 4), 30, keeps_values=True).policy()
    tensors = table_tensors(policy.table)
    text = table_text(policy.table, policy.optimum)
    again = parse_table(tensors, text)[0]
    np.testing.assert_array_equal(again.values, policy.table.values, strict=True)
    values = tensors["values"]
    for damaged in (values[:, 1:], values[:-1], values * np.float32(np.nan)):
        with pytest.raises(ValueError, match="its values do not fit together"):
            parse_table({**tensors, "values": damaged}, text)


def test_merges_of_earlier_files_are_read(policy):
    # word, mask and value in it, bits to keep of all words
    tensors = table_tensors(policy.table)
    (mask, value, keep), *_ = tensors["merges"][:, :, 0]
    assert np.all(tensors["merges"][0, 0, 1:] == 0)
    earlier = {**tensors, "merges": np.array([[0, mask, value, keep]], np.uint64)}
    text = table_text(policy.table, policy.optimum)
    again = parse_table(earlier, text)[0]
    np.testing.assert_array_equal(again.merges, tensors["merges"][:1], strict=True)
    for damaged in (earlier["merges"] + np.uint64(7), earlier["merges"].astype(np.int64)):
        with pytest.raises(ValueError, match="its merges do not fit together"):
            parse_table({**earlier, "merges": damaged}, text)


def test_a_table_that_is_not_proven_says_so_and_is_read_back(policy, tmp_path):
    estimate = Estimate(value=-2.5, error=0.25, episodes=100, missed=0.125, states=7)
    found = TablePolicy(policy.problem, policy.table, estimate, 5)
    path = tmp_path / "table"
    save_policy(path, found.to_saved())
    assert read_container(path, [ESTIMATE_FORMAT])[0]["format"] == ESTIMATE_FORMAT
    again = restored(load_policy(path), policy.problem, str(path))
    assert isinstance(again, TablePolicy)
    assert again.claim == estimate
    assert again.optimum is None
    assert again.returns.tolist() == [-2.5]
    assert again(0, observation(0, "dry"))["go"] is True
    assert "trials" in str(again.explain())
    assert "optimum" not in again._repr_html_()
    assert repr(again).endswith(": a table that trials have found, 7 states>")


STATELESS = """
domain stalls {
    types { stall : object; };
    pvariables {
        PAYS(stall) : { non-fluent, real, default = 1.0 };
        busy : { interm-fluent, bool };
        sell(stall) : { action-fluent, bool, default = false };
    };
    cpfs { busy = exists_{?s : stall} [sell(?s)]; };
    reward = (sum_{?s : stall} [PAYS(?s) * sell(?s)]) - 0.5 * busy;
}
non-fluents nf {
    domain = stalls; objects { stall : {a, b}; }; non-fluents { PAYS(b) = 2.0; };
}
instance one {
    domain = stalls; non-fluents = nf; max-nondef-actions = 1; horizon = 3; discount = 1.0;
}
"""


def test_a_problem_without_state_is_played_and_its_table_read_back(tmp_path):
    policy = find_optimum(problem_from(STATELESS), 30).policy()
    assert policy.optimum.value == 4.5
    policy.save(tmp_path / "table")
    again = restored(load_policy(tmp_path / "table"), policy.problem, "here")
    for each in (policy, again):
        assert each(0, {})["sell"].tolist() == [False, True]
        assert each.evaluate(episodes=1).mean == 4.5


def test_a_table_is_no_planners_parameters(policy, tmp_path):
    path = tmp_path / "table"
    save_policy(path, policy.to_saved())
    assert "format 'mdpo-rddl table" in one_line(lambda: load_parameters(path))


def test_a_table_of_another_problem_is_refused(policy, tmp_path):
    saved = policy.to_saved()
    other = toys.lamp(tmp_path, 3)
    with pytest.raises(InputError, match=r"^here: saved for .*walk.*, not for .*lamp"):
        restored(saved, other, "here")
    # it claims to be the lamp's
    liar = replace(saved, problem={**saved.problem, "digest": other.digest})
    with pytest.raises(InputError, match=r"^here: damaged policy file: its fluents are not"):
        restored(liar, other, "here")


CHANGES = {
    "an action that is not there": lambda t: t.update(action=t["action"] + 100),
    "a run too many": lambda t: t.update(until_step=np.append(t["until_step"], t["action"][:1])),
    "runs outside": lambda t: t.update(first_run=t["first_run"] * 2),
    "runs backward": lambda t: t.update(first_run=-t["first_run"]),
    "states of two words": lambda t: t.update(states=np.repeat(t["states"], 2, axis=1)),
    "real states": lambda t: t.update(states=t["states"].astype(float)),
    "a place beyond the word": lambda t: t.update(places=t["places"] + 64),
    "merges of two words": lambda t: t.update(merges=np.repeat(t["merges"], 2, axis=2)),
    "a merge without the bits to keep": lambda t: t.update(merges=t["merges"][:, :2]),
    "a tensor less": lambda t: t.pop("places"),
    "a tensor more": lambda t: t.update(places2=t["places"]),
    "no actions": lambda t: [t.pop(name) for name in list(t) if name.startswith("actions/")],
    "fewer values of one action": lambda t: t.update({"actions/go": t["actions/go"][:1]}),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_tensors_that_do_not_fit_together_are_refused(policy, change):
    tensors = table_tensors(policy.table)
    text = table_text(policy.table, policy.optimum)
    assert parse_table(tensors, text)[1] == replace(policy.optimum, seconds=None)
    change(tensors)
    with pytest.raises((KeyError, TypeError, ValueError)):
        parse_table(tensors, text)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fluents", "[1, 2]"),
        ("objects", "[]"),
        ("optimum", "{}"),
        ("optimum", json.dumps({"value": float("nan"), "states": 1})),
        ("estimate", json.dumps({"value": float("nan"), "error": 1, "missed": 0})),
    ],
)
def test_text_that_says_nothing_useful_is_refused_in_one_line(policy, tmp_path, name, value):
    path = tmp_path / "table"
    save_policy(path, policy.to_saved())
    metadata, tensors = read_container(path, [TABLE_FORMAT])
    write_container(path, tensors, {**metadata, name: value})
    assert one_line(lambda: load_policy(path)).startswith(f"{path}: damaged policy file: ")


def test_a_table_is_the_same_file_each_time(policy, tmp_path):
    slower = TablePolicy(policy.problem, policy.table, replace(policy.optimum, seconds=9.0), 5)
    for name, each in (("one", policy), ("other", slower)):
        each.save(tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "other").read_bytes()


def test_a_table_has_no_equation(policy):
    explanation = policy.explain()
    assert explanation.equations == ()
    assert "table of a proven optimum" in str(explanation)


def test_that_the_environment_raises_errors_is_not_forgotten(policy, tmp_path):
    # or somebody would think at the decision, who does not know where it does
    raising = TablePolicy(replace(policy.problem, raises=True), policy.table, policy.claim, 0)
    save_policy(tmp_path / "raising", raising.to_saved())
    again = restored(load_policy(tmp_path / "raising"), policy.problem, "here")
    assert again.problem.raises
    estimate = Estimate(value=-2.5, error=0.25, episodes=100, missed=0.125, states=7)
    assert choose(TablePolicy(again.problem, again.table, estimate, 0), 0.1).reason == RAISES
    assert not restored(policy.to_saved(), policy.problem, "here").problem.raises


def test_a_pickled_table_plays_the_same(policy):
    again = pickle.loads(pickle.dumps(policy))
    assert again(1, observation(1, "dry"))["go"] is True
    assert again(1, observation(1, "wet"))["go"] is False
    assert again.optimum == policy.optimum


def test_what_is_no_step_or_no_observation_is_refused(policy):
    seen = observation(0, "dry")
    assert "got -1" in one_line(lambda: policy(-1, seen))
    assert one_line(lambda: policy(0, {"at": seen["at"]})) == "the observation lacks sky"
    assert "got NoneType" in one_line(lambda: policy(0, None))
    said = one_line(lambda: policy(0, {**seen, "sky": np.array(["green"])}))
    assert said == "the observation has sky that is no weather, but green"
