"""Bounds on what plans return that know all random numbers of their episode."""

import itertools

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.problem.episode import Episode
from mdpo_rddl.problem.evaluation import episode_seeds, evaluate
from mdpo_rddl.problem.hindsight.bound import find_bounds
from mdpo_rddl.problem.hindsight.draws import DrawsSimulator, MissingDrawError, draws_of
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import make_environment

DOMAIN = """
domain toy {
    types { tank : object; };
    pvariables {
        LEVEL(tank) : { non-fluent, real, default = 10.0 };
        volume(tank) : { state-fluent, real, default = 5.0 };
        rain : { interm-fluent, real };
        fill(tank) : { action-fluent, KIND, default = DEFAULT };
    };
    cpfs {
        rain = abs[Normal(0.0, 1.0)];
        volume'(?t) = NEXT;
    };
    reward = sum_{?t : tank} [REWARD];
    action-preconditions { RULE };
}
"""
INSTANCE = """
non-fluents nf { domain = toy; objects { tank : {t1, t2}; };
    non-fluents { LEVEL(t2) = 8.0; }; }
instance one {
    domain = toy; non-fluents = nf; init-state { volume(t1) = 2.0; };
    max-nondef-actions = MOST; horizon = 3; discount = 0.9;
}
"""
BOX = "forall_{?t : tank} [fill(?t) >= 0.0]; forall_{?t : tank} [fill(?t) <= 3.0];"
FREE = "forall_{?t : tank} [volume(?t) >= -1000.0];"


def toy(following, reward, kind="bool", rule=FREE, most="pos-inf"):
    text = DOMAIN + INSTANCE
    words = {
        "NEXT": following,
        "REWARD": reward,
        "KIND": kind,
        "DEFAULT": "false" if kind == "bool" else "0.0",
        "RULE": rule,
        "MOST": most,
    }
    for word, value in words.items():
        text = text.replace(word, value)
    return problem_from(text)


def noop(step, state):
    return {}


def bounds_of(problem, episodes=2, policy=noop):
    return find_bounds(problem, policy, episodes, seed=3, seconds=60.0)


def test_a_plan_that_fills_what_leaks_is_found():
    following = "volume(?t) + fill(?t) - Uniform(0.0, 1.0)"
    problem = toy(following, "-abs[volume'(?t) - LEVEL(?t)]", "real", BOX)
    found = bounds_of(problem)
    assert found.reason is None
    env = make_environment(problem, backend=DrawsSimulator)
    for each, seed in zip(found.episodes, episode_seeds(3, 2), strict=True):
        episode = Episode(env, noop, Referee(env))
        episode.play(env.reset(seed=seed)[0])
        volume, total = np.array([2.0, 5.0]), 0.0
        for step, drawn in enumerate(env.sampler.draws):
            (leak,) = (value for value in drawn.values() if np.shape(value))
            volume += np.clip(np.array([10.0, 8.0]) - volume + leak, 0.0, 3.0) - leak
            total -= 0.9**step * np.abs(volume - [10.0, 8.0]).sum()
        assert each.policy == episode.total
        assert each.bound == pytest.approx(total, abs=1e-6)
        assert each.plan == pytest.approx(total, abs=1e-6)
        assert each.is_attained


# each with operators of its own
STEPS = {
    "conditions": (
        "if (fill(?t)) then volume(?t) + rain else volume(?t) - 1.0",
        "if (volume'(?t) >= LEVEL(?t)) then -3.0 else if (volume'(?t) > 4.6) then 2.0 else rain",
    ),
    "smallest and largest": (
        "min[LEVEL(?t), max[0.0, volume(?t) + 4 * fill(?t) - 2 * rain]]",
        "min[volume'(?t), 7.0] - abs[volume(?t) - 5] / 2 - 0.5 * fill(?t)",
    ),
    "bools": (
        "volume(?t) + (fill(?t) ^ (volume(?t) <= 6.0)) * rain - (fill(?t) | (volume(?t) < 1.0))",
        "(fill(?t) => (volume'(?t) > 3.0)) - 0.3 * ~fill(?t)",
    ),
    "of each other": (
        "(sum_{?s : tank} [volume(?s)]) / 2 - fill(?t) + rain",
        "(volume'(?t) > volume(?t)) * 4 - (fill(?t) ~= (volume(?t) > 4.0)) * volume(?t)",
    ),
    "all of them": (
        "volume(?t) + (forall_{?s : tank} [fill(?s)]) * 2 - (exists_{?s : tank} [fill(?s)])",
        "min[volume'(?t) - LEVEL(?t), LEVEL(?t) - volume'(?t)] * rain",
    ),
}


def best_of_all_plans(problem, seed, most=2):
    """The best return of all plans, and the no-op's."""
    env = make_environment(problem, backend=DrawsSimulator)
    Episode(env, noop, Referee(env)).play(env.reset(seed=seed)[0])
    draws = draws_of(env).draws
    draws_of(env).replay(draws)
    choices = [c for c in itertools.product([False, True], repeat=2) if sum(c) <= most]
    returns = []
    for plan in itertools.product(choices, repeat=3):
        steps = [{"fill": np.array(step)} for step in plan]
        episode = Episode(env, lambda step, state, steps=steps: steps[step], Referee(env))
        episode.play(env.reset(seed=0)[0])
        returns.append(episode.total)
    return max(returns), returns[0]


@pytest.mark.parametrize("name", STEPS)
def test_a_bound_is_the_best_of_all_plans(name):
    problem = toy(*STEPS[name])
    (found,) = bounds_of(problem, episodes=1).episodes
    best, idle = best_of_all_plans(problem, episode_seeds(3, 1)[0])
    assert found.policy == pytest.approx(idle)
    assert best > idle
    assert found.bound == pytest.approx(best, abs=1e-5)
    assert found.plan == pytest.approx(best, abs=1e-5)


def test_few_actions_at_once_are_a_limit_of_the_plans():
    problem = toy("volume(?t) + fill(?t)", "volume'(?t)", most="1")
    best = best_of_all_plans(problem, 0, most=1)[0]
    assert bounds_of(problem, episodes=1).episodes[0].bound == pytest.approx(best)


@pytest.mark.parametrize(
    ("following", "reward", "reason"),
    [
        ("volume(?t) + Uniform(0.0, 1.0 + fill(?t))", "0.0", "law depends on the actions"),
        ("volume(?t) + fill(?t)", "volume'(?t) * volume'(?t)", "a product of two fluents"),
        ("volume(?t) + fill(?t)", "exp[volume'(?t)]", "exp of what the actions change"),
        ("volume(?t) + fill(?t)", "1 / volume'(?t)", "a division by what the actions change"),
    ],
)
def test_what_is_not_linear_has_no_bound_and_says_why(following, reward, reason):
    found = bounds_of(toy(following, reward))
    assert found.episodes == ()
    assert reason in found.reason


def test_a_draw_that_the_episode_has_not_made_ends_the_bounds():
    problem = toy("volume(?t) + (if (fill(?t)) then Uniform(0.0, 1.0) else 0.0)", "volume'(?t)")
    assert "did not draw" in bounds_of(problem).reason
    all_filled = bounds_of(problem, policy=lambda step, state: {"fill": np.array([True, True])})
    assert all(each.is_attained for each in all_filled.episodes)


def test_without_time_there_is_no_bound():
    problem = toy("volume(?t) + fill(?t)", "volume'(?t)")
    clock = itertools.count(0.0, 40.0).__next__
    found = find_bounds(problem, noop, 2, 0, 60.0, clock)
    assert len(found.episodes) < 2
    assert found.reason


def test_random_numbers_are_kept_and_played_again():
    problem = toy("volume(?t) + fill(?t) - Uniform(0.0, 1.0)", "volume'(?t)")
    env = make_environment(problem, backend=DrawsSimulator)
    simulator = draws_of(env)
    plain = make_environment(problem)
    # keeping them changes nothing
    expected = evaluate(plain, noop, 2, 5).returns
    np.testing.assert_array_equal(evaluate(env, noop, 2, 5).returns, expected)
    draws = simulator.draws
    assert len(draws) == 3
    simulator.replay(draws)
    again = evaluate(env, noop, 2, seed=8).returns
    np.testing.assert_array_equal(again, expected[[1, 1]])
    simulator.replay(draws[:2])
    with pytest.raises(MissingDrawError):
        evaluate(env, noop, 1, seed=8)
    simulator.replay(None)
    assert evaluate(env, noop, 1, seed=8).returns[0] != expected[1]
    with pytest.raises(TypeError, match="RDDLSimulator"):
        draws_of(plain)


ENDING = """
domain ending {
    pvariables {
        s : { state-fluent, real, default = 2.0 };
        over : { state-fluent, bool, default = false };
        quit : { action-fluent, bool, default = false };
        g : { action-fluent, real, default = 0.0 };
        n : { action-fluent, int, default = 0 };
    };
    cpfs { s' = NEXT; over' = quit; };
    reward = REWARD;
    action-preconditions { g >= 0; g <= 1; };
    END
}
non-fluents nf { domain = ending; }
instance one { domain = ending; non-fluents = nf; horizon = 5; discount = 1.0; }
"""


def ending(following="s - g", reward="g + 0.5 * quit", end=""):
    words = {"NEXT": following, "REWARD": reward, "END": end}
    text = ENDING
    for word, value in words.items():
        text = text.replace(word, value)
    return problem_from(text)


@pytest.mark.parametrize("end", ["termination { over; };", "state-invariants { ~over; };"])
def test_an_episode_that_the_policy_has_ended_bounds_no_longer_one(end):
    quits = {"quit": True, "g": 1.0}
    found = bounds_of(ending(end=end), policy=lambda step, state: quits)
    assert found.episodes == ()
    assert found.reason == "an end of the episode that may depend on the actions"
    # one that ends whatever is done has a bound
    found = bounds_of(ending("s - 1", "g", "termination { s < 0.5; };"))
    assert [each.bound for each in found.episodes] == pytest.approx([2.0, 2.0])


def test_a_return_that_no_action_changes_is_its_own_bound():
    found = bounds_of(ending("s + 1", "s"))
    assert [each.bound for each in found.episodes] == [2.0 + 3.0 + 4.0 + 5.0 + 6.0] * 2


def test_an_error_of_the_environment_is_the_reason_why_there_is_no_bound():
    found = bounds_of(ending("s + 1 + 0.001 * Normal(0.0, 3.5 - s)", "s"))
    assert found.episodes == ()
    assert found.reason.startswith("an episode ends in an error: ")
    assert "\n" not in found.reason
