"""The players that mark what 0 is worth: doing nothing, and legal random actions."""

import numpy as np
import pytest

from mdpo_rddl.ipc.names import FLOOR, JAXPLAN, PLANNER_NAMES
from mdpo_rddl.ipc.noop_player import NoopPlayer
from mdpo_rddl.ipc.random_player import RandomPlayer
from mdpo_rddl.ipc.registry import PLANNERS
from mdpo_rddl.ipc.trial import play
from mdpo_rddl.problem.load import load_problem, make_environment

DOMAIN = """
domain mixed {
    types { unit : object; colour : {@red, @green, @blue}; };
    pvariables {
        s : { state-fluent, real, default = 0.0 };
        shade : { state-fluent, colour, default = @red };
        on(unit) : { action-fluent, bool, default = false };
        box(unit) : { action-fluent, real, default = 0.0 };
        low : { action-fluent, real, default = 0.0 };
        high : { action-fluent, real, default = 0.0 };
        free : { action-fluent, real, default = 3.0 };
        count : { action-fluent, int, default = 1 };
        paint : { action-fluent, colour, default = @green };
    };
    cpfs { s' = s + 1.0; shade' = @blue; };
    reward = s;
    action-preconditions {
        forall_{?u : unit} [box(?u) >= -1.0 ^ box(?u) <= 2.0];
        low >= 4.0 | s < 1.0;
        low >= -2.0;
        high <= 7.0;
        shade ~= @blue | paint == @blue;
        count >= 1;
        count <= 3;
    };
}
"""
INSTANCE = """
non-fluents nf { domain = mixed; objects { unit : {a, b, c, d}; }; }
instance one {
    domain = mixed; non-fluents = nf; max-nondef-actions = MOST; horizon = 3; discount = 1.0;
}
"""


def mixed_problem(folder, most="pos-inf"):
    (folder / "d.rddl").write_text(DOMAIN)
    (folder / "i.rddl").write_text(INSTANCE.replace("MOST", most))
    return load_problem(str(folder / "d.rddl"), str(folder / "i.rddl"))


def drawn(problem, state, count=200):
    player, rng = RandomPlayer(), np.random.default_rng(0)
    player.prepare(problem, 1.0, 0)
    actions = [player.act(0, state, rng) for _ in range(count)]
    return {name: np.array([action[name] for action in actions]) for name in actions[0]}


def test_every_kind_of_action_is_drawn_from_all_that_it_may_be(tmp_path):
    actions = drawn(mixed_problem(tmp_path), {"s": np.zeros(1)})
    assert actions["on"].mean(axis=0) == pytest.approx(0.5, abs=0.15)
    for name, low, high in (("box", -1, 2), ("low", -2, 8), ("high", -3, 7)):
        span = high - low
        assert low <= actions[name].min() < low + 0.1 * span
        assert high - 0.1 * span < actions[name].max() <= high
    assert actions["free"].mean() == pytest.approx(3.0, abs=0.3)
    assert actions["free"].std() == pytest.approx(1.0, abs=0.2)
    counts = np.bincount(actions["count"])
    assert len(counts) == 4
    assert counts[0] == 0
    assert counts[1:].min() > 40
    assert set(actions["paint"]) == {0, 1, 2}


def test_preconditions_are_checked_in_the_observed_state(tmp_path):
    problem = mixed_problem(tmp_path)
    assert drawn(problem, {"s": np.zeros(1)})["low"].min() < 4.0
    later = drawn(problem, {"s": np.ones(1)}, 20)
    assert later["low"].min() >= 4.0
    # an environment shows objects by their names
    assert set(drawn(problem, {"shade": np.array(["blue"])}, 20)["paint"]) == {2}


def test_no_more_actions_than_allowed_leave_their_default(tmp_path):
    problem = mixed_problem(tmp_path, most="2")
    env, player = make_environment(problem), RandomPlayer()
    player.prepare(problem, 1.0, 0)
    defaults, rng = env.sampler.noop_actions, np.random.default_rng(0)
    for _ in range(20):
        actions = player.act(0, {"s": np.zeros(1)}, rng)
        changed = sum(np.count_nonzero(actions[name] != defaults[name]) for name in actions)
        assert changed <= 2


def test_the_random_numbers_are_those_of_the_trial(tmp_path):
    problem = mixed_problem(tmp_path)
    player, env = RandomPlayer(), make_environment(problem)
    player.prepare(problem, 1.0, 0)
    first, second, other = (
        play(env, player, 0, np.random.default_rng(seed), lenient=False)[1] for seed in (1, 1, 2)
    )
    columns = [trace.arrays()["action/box"] for trace in (first, second, other)]
    np.testing.assert_array_equal(columns[0], columns[1])
    assert not np.array_equal(columns[0], columns[2])


def test_recsim_recommends_one_item_to_half_of_the_consumers():
    problem = load_problem("RecSim_ippc2023", "1")
    player, env = RandomPlayer(), make_environment(problem, enforce_action_constraints=True)
    player.prepare(problem, 1.0, 0)
    rng, (state, _) = np.random.default_rng(0), env.reset(seed=0)
    totals = []
    for step in range(20):
        actions = player.act(step, state, rng)
        totals.append(actions["recommend"].sum(axis=1))
        state, *_ = env.step(actions)
    assert set(np.ravel(totals)) == {0, 1}
    assert np.mean(totals) == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize("name", ["HVAC", "MarsRover", "PowerGen", "RaceCar", "UAV"])
def test_both_play_legally(name):
    problem = load_problem(f"{name}_ippc2023", "1", 5)
    for player in (NoopPlayer(), RandomPlayer()):
        player.prepare(problem, 1.0, 0)
        rng = np.random.default_rng(0)
        result, _ = play(make_environment(problem), player, 0, rng, lenient=False)
        assert result.status == "ok", result.cause
        assert result.violations == 0


def test_the_names_that_are_offered_are_the_planners_that_there_are():
    assert tuple(PLANNERS) == PLANNER_NAMES
    assert {*JAXPLAN, *FLOOR} < set(PLANNER_NAMES)
