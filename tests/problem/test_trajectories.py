"""Trajectories: what is kept of episodes, and how much."""

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.trajectories import (
    Trajectories,
    TrajectoriesRecorder,
    fluents_text,
    parse_fluents,
)

TEXT = """
domain walk {
    types { robot : object; mood : {@calm, @angry}; };
    pvariables {
        place(robot) : { state-fluent, real, default = 0.0 };
        near(robot, robot) : { state-fluent, bool, default = false };
        feels : { state-fluent, mood, default = @angry };
        go(robot) : { action-fluent, real, default = 1.0 };
    };
    cpfs {
        place'(?r) = place(?r) + go(?r);
        near'(?r, ?s) = place(?r) >= 2.0;
        feels' = @calm;
    };
    reward = -1.0;
    termination { exists_{?r : robot} [place(?r) >= 3.0]; };
}
non-fluents nf { domain = walk; objects { robot : {a, b}; }; }
instance one {
    domain = walk; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 6; discount = 1.0;
}
"""
NAN = np.nan


def recorded(problem, episodes=2, **options):
    recorder = TrajectoriesRecorder(problem.model, episodes, **options)

    def policy(step, state):
        return {"go": np.array([0.5, 0.0])} if step == 0 else {}

    evaluate(make_environment(problem), policy, episodes, 0, recorder=recorder)
    return recorder.result()


def test_states_are_those_before_the_actions_and_end_with_the_episode():
    play = recorded(problem_from(TEXT))
    # a goes 0.5, 1, 1, 1 and is past 3 then
    place = play.values["state", "place"][0].T
    np.testing.assert_array_equal(place, [[0, 0.5, 1.5, 2.5, NAN, NAN], [0, 0, 1, 2, NAN, NAN]])
    go = play.values["action", "go"][1].T
    np.testing.assert_array_equal(go, [[0.5, 1, 1, 1, NAN, NAN], [0, 1, 1, 1, NAN, NAN]])
    np.testing.assert_array_equal(play.rewards[0], [-1, -1, -1, -1, NAN, NAN])
    feels = play.values["state", "feels"][0, :, 0]
    np.testing.assert_array_equal(feels, [1, 0, 0, 0, NAN, NAN])
    near = {f.name: f for f in play.fluents}["near"]
    assert near.objects == ("a, a", "a, b", "b, a", "b, b")
    np.testing.assert_array_equal(play.values["state", "near"][0, :4, 0], [0, 0, 0, 0])


def test_an_episode_that_ends_where_it_begins_has_its_objects():
    play = recorded(problem_from(TEXT.replace("place(?r) >= 3.0", "place(?r) >= 0.0")))
    assert play.values["state", "near"].shape == (2, 6, 4)
    assert play.values["state", "feels"].shape == (2, 6, 1)
    assert np.isnan(play.values["action", "go"]).all()
    assert play.rewards.shape == (2, 6)


def test_little_memory_keeps_few_episodes_of_few_objects():
    problem = problem_from(TEXT)
    # two places, four neighbours, one feeling and two actions at six steps
    most = 6 * 9 * 7
    play = recorded(problem, episodes=20, most_numbers=most)
    assert play.rewards.shape == (7, 6)
    play = recorded(problem, episodes=20, most_numbers=6 * 4 * 5)
    assert play.rewards.shape == (5, 6)
    assert sum(values.size for values in play.values.values()) <= 6 * 4 * 5
    near = {f.name: f for f in play.fluents}["near"]
    assert (near.count, near.objects) == (4, ("a, a",))


def test_a_long_horizon_is_thinned():
    problem = problem_from(TEXT.replace("place(?r) >= 3.0", "place(?r) >= 9999.0"), horizon=1200)
    play = recorded(problem, episodes=1)
    np.testing.assert_array_equal(play.steps[:3], [0, 3, 6])
    assert play.values["state", "place"].shape == (1, 400, 2)
    np.testing.assert_array_equal(play.values["state", "place"][0, :3, 1], [0, 2, 5])


def test_arrays_and_descriptions_come_back():
    play = recorded(problem_from(TEXT))
    fluents = parse_fluents(fluents_text(play.fluents))
    again = Trajectories.from_arrays(fluents, play.arrays("policy"), "policy")
    assert again.fluents == play.fluents
    for key, values in play.values.items():
        np.testing.assert_array_equal(again.values[key], values)
    with pytest.raises(ValueError, match="no descriptions"):
        parse_fluents('[{"name": 1}]')


def test_an_evaluation_ends_where_it_is_told_to():
    problem = problem_from(TEXT)
    found = evaluate(make_environment(problem), lambda step, state: {}, 9, 0, lambda: False)
    assert found.lengths.tolist() == [3]
