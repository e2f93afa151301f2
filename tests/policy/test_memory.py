"""A policy that remembers: what it plays is what the exact model's rollouts have judged."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import toy
from pyRDDLGym import RDDLEnv

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.exact import exact_returns
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.policy.transfer import transferred
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

KEY = jax.random.PRNGKey(0)
EVERYTHING = {
    "observations": [1.0, 3.0],
    "actions": [1.0, 3.0],
    "observation_traces": [2.0],
    "action_traces": [2.0],
}


def random_policy(problem, **arguments):
    """A policy whose weights are all drawn."""
    config = preset(1.0).without_section("Search").with_policy_arguments(**arguments)
    planner = build_planner(problem, config).planner
    params = planner.plan.initializer(KEY, {}, None)
    random = np.random.default_rng(2)
    params = jax.tree.map(
        lambda leaf: 0.03 * random.normal(size=leaf.shape).astype(leaf.dtype), params
    )
    return Policy(problem, config, params, {}, seed=7, compiled=Compiled(planner))


@pytest.fixture(scope="module")
def policy():
    """Plays a problem of reals, integers and bools, in which nothing is random."""
    return random_policy(toy("drift"), memory=EVERYTHING, state_scales={"seen": [0.5, 2.0]})


def judged(policy, rollouts=2):
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[jnp.newaxis], policy.params)
    return np.asarray(exact_returns(policy.planner, rollouts)(KEY, one))[0]


def decisions(policy, episodes=1):
    """Steps and what was seen and done at them."""
    env, found = make_environment(policy.problem), []

    def watched(step, state):
        action = policy(step, state)
        found.append((step, state, action))
        return action

    evaluate(env, watched, episodes, seed=3)
    return found


def assert_same(left, right):
    for name in left:
        np.testing.assert_array_equal(left[name], right[name])


def test_what_was_played_is_remembered_where_it_is_not_what_was_decided(policy):
    env = make_environment(policy.problem)
    state = env.reset(seed=0)[0]
    policy.reset()
    decided = policy(0, state)
    name, value = next((n, v) for n, v in decided.items() if np.asarray(v).dtype.kind == "f")
    lasts = []
    for played in (decided, {**decided, name: np.asarray(value) + 0.25}, decided):
        policy.was_played(played)
        lasts.append(policy._play._one._after[f"last {name}"])
    # of a box of 4
    np.testing.assert_allclose(lasts[1] - lasts[0], 0.25 / 4.0, rtol=1e-5)
    np.testing.assert_array_equal(lasts[2], lasts[0])


def test_a_rollout_returns_what_play_does(policy):
    played = policy.evaluate(episodes=2)
    np.testing.assert_allclose(played.returns, judged(policy), rtol=2e-6)
    assert played.illegal_actions == 0


def test_what_it_does_depends_on_what_it_remembers(policy):
    for step, state, action in decisions(policy)[2:]:
        policy.reset()
        forgetful = policy(step, state)
        assert not np.allclose(forgetful["push"], action["push"], rtol=1e-3)


def test_an_episode_begins_with_an_empty_memory(policy):
    seen = decisions(policy, episodes=2)
    for first, second in zip(seen[:8], seen[8:], strict=True):
        assert_same(first[2], second[2])


def test_a_step_that_is_asked_for_again_is_the_same_decision(policy):
    for step, state, action in decisions(policy):
        assert_same(policy(step, state), action)
        assert_same(policy(step, state), action)


def test_a_reset_agent_plays_the_episode_again(policy):
    seen = decisions(policy)
    for _ in range(2):
        policy.reset()
        for _, state, action in seen:
            assert_same(action, policy.sample_action(state))


def test_episodes_side_by_side_are_remembered_each_by_itself(policy):
    seen = decisions(policy)
    policy.reset()
    # the second episode shows other things
    for step, state, action in seen[:-1]:
        other = {name: value if step == 0 else value + 1 for name, value in state.items()}
        both = {name: np.stack([state[name], other[name]]) for name in state}
        found = policy.batch(step, both)
        np.testing.assert_allclose(found["push"][0], action["push"], rtol=1e-5)
        assert step == 0 or not np.allclose(found["push"][1], action["push"], rtol=1e-3)
    with pytest.raises(InputError, match="1 observations at step 7, and 2 at the one before"):
        policy.batch(7, {name: value[np.newaxis] for name, value in state.items()})


def test_nothing_stands_in_for_an_observation_that_is_missing_later(policy):
    nothing = {"seen": np.array([None]), "far": np.array([None])}
    policy.batch(0, nothing)
    with pytest.raises((TypeError, ValueError)):
        policy.batch(1, nothing)


def test_both_kinds_of_environments_are_played_alike(policy):
    returns = []
    for vectorized in (False, True):
        env = RDDLEnv(policy.problem.model, None, vectorized=vectorized)
        returns.append(policy.evaluate(env, episodes=2, seed=5).returns)
    np.testing.assert_allclose(returns[0], returns[1], rtol=1e-6)


def test_what_is_saved_remembers_as_well(policy, tmp_path):
    policy.save(tmp_path / "policy")
    again = Policy.from_saved(load_policy(tmp_path / "policy"), policy.problem, "here")
    for (_, _, expected), (_, _, found) in zip(decisions(policy), decisions(again), strict=True):
        assert_same(expected, found)


def test_the_rule_in_words_names_what_is_remembered(policy):
    text = str(policy.explain(seconds=0.0))
    for name in ("(last seen - 0.5)", "mean of brake over 3 steps", "trace of far over 2 steps"):
        assert name in text
    assert "'last f'" in text


def test_the_same_rule_is_carried_over_whole(policy):
    plan = policy.planner.feedback_plan
    zeros = jax.tree.map(jnp.zeros_like, policy.params)
    carried = transferred(plan, policy.params, plan, zeros, is_same=True)
    assert carried.left_out == ()
    jax.tree.map(np.testing.assert_allclose, carried.params, policy.params)


@pytest.fixture(scope="module")
def signal():
    """Lamps that are shown once; whoever remembers them is right at every step after."""
    policy = random_policy(toy("signal"), memory={"observations": [4.0]}, topology=[], plan=False)
    params = jax.tree.map(np.zeros_like, policy.params)
    gains = {"gain on shown": 1.0, "gain on mean of shown over 4 steps": 1.0, "bias": -0.01}
    own = {name: np.full(2, gain, np.float32) for name, gain in gains.items()}
    return policy.with_params({**params, "own": {"say": {**params["own"]["say"], **own}}})


# two lamps: what is shown is known at one step, and is a guess at the three after it
MEMORYLESS = 2 * (1 + 3 * 0.5)


def test_memory_beats_whatever_knows_the_last_observation_alone(signal):
    assert judged(signal, 64).tolist() == [2 * 4] * 64
    assert signal.evaluate(episodes=10).returns.tolist() == [2 * 4] * 10
    own = {"say": {**signal.params["own"]["say"]}}
    own["say"]["gain on mean of shown over 4 steps"] = np.zeros(2, np.float32)
    forgetful = signal.with_params({**signal.params, "own": own})
    assert np.mean(judged(forgetful, 64)) == pytest.approx(MEMORYLESS, abs=1.0)
