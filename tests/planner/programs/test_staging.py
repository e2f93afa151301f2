"""Functions split by what their operations depend on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.planner.programs.staging import Stages

KEY = jax.random.PRNGKey(1)
STATE = jnp.array([0.3, -1.2, 2.0])


def step(scale, key, state):
    """Draws, of which one depends on the state, and a nested call that mixes all arguments."""
    one, two = jax.random.split(key)

    @jax.jit
    def mixed(key, state):
        return jax.nn.relu(state) * scale["a"] + jax.random.normal(key, state.shape)

    drawn = jax.random.bernoulli(two, jax.nn.sigmoid(state))
    return {"next": mixed(one, state), "drawn": drawn, "scale": scale["a"] * 2.0}, key


SCALE = {"a": jnp.float32(1.5), "unused": jnp.ones(2)}


def run_all(stages, *arguments):
    residuals = []
    for number, argument in enumerate(arguments):
        found = stages.run(number, residuals, argument)
        residuals.append(found)
    return found


def test_the_stages_give_what_the_function_gives():
    stages = Stages(step, SCALE, KEY, STATE)
    expected, found = step(SCALE, KEY, STATE), run_all(stages, SCALE, KEY, STATE)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
        assert one.dtype == other.dtype


def test_only_what_needs_the_state_is_left_to_the_last_stage():
    stages = Stages(step, SCALE, KEY, STATE)
    first = stages.run(0, [], SCALE)
    second = stages.run(1, [first], KEY)
    program = str(jax.make_jaxpr(lambda s: stages.run(2, [first, second], s))(STATE))
    assert "threefry" not in program
    assert "random_bits" not in program
    assert "logistic" in program
    # the normal numbers, and the uniform ones behind the bernoulli draw
    assert [leaf.shape for leaf in stages.residual_types[1]].count((3,)) == 2


def test_a_result_that_is_an_argument_is_told_apart():
    stages = Stages(step, SCALE, KEY, STATE)
    # drawn, next, scale, key
    assert stages.passes_through() == [False, False, False, True]


def test_gradients_flow_through_the_last_stage():
    stages = Stages(step, SCALE, KEY, STATE)
    first = stages.run(0, [], SCALE)
    second = stages.run(1, [first], KEY)

    def total(state):
        return jnp.sum(stages.run(2, [first, second], state)[0]["next"])

    expected = jax.grad(lambda state: jnp.sum(step(SCALE, KEY, state)[0]["next"]))(STATE)
    np.testing.assert_allclose(jax.grad(total)(STATE), expected)


def test_stages_can_be_vectorised_over_the_early_arguments():
    stages = Stages(step, SCALE, KEY, STATE)
    first = stages.run(0, [], SCALE)
    keys = jax.random.split(KEY, 5)
    early = jax.vmap(lambda key: stages.run(1, [first], key))(keys)
    late = jax.vmap(lambda drawn: stages.run(2, [first, drawn], STATE))(early)
    expected = jax.vmap(lambda key: step(SCALE, key, STATE))(keys)
    np.testing.assert_allclose(late[0]["next"], expected[0]["next"], rtol=1e-6)
    np.testing.assert_array_equal(late[0]["drawn"], expected[0]["drawn"])


@pytest.mark.parametrize("loop", ["scan", "while", "cond"])
def test_loops_within_are_kept_whole(loop):
    def function(early, late):
        if loop == "scan":
            return jax.lax.scan(lambda c, x: (c + late, x * c), early, jnp.arange(3.0))
        if loop == "while":
            return jax.lax.while_loop(lambda c: c < late, lambda c: c * 2.0, early)
        return jax.lax.cond(late > 0, lambda: early, lambda: late)

    early, late = jnp.float32(0.7), jnp.float32(5.0)
    found = run_all(Stages(function, early, late), early, late)
    for one, other in zip(
        jax.tree.leaves(found), jax.tree.leaves(function(early, late)), strict=True
    ):
        np.testing.assert_allclose(one, other)


def test_a_constant_result():
    stages = Stages(lambda early, late: (jnp.zeros(2), 1.0), STATE, STATE)
    zeros, one = run_all(stages, STATE, STATE)
    assert zeros.tolist() == [0.0, 0.0]
    assert one == 1.0


def test_what_has_effects_happens_once_at_the_end():
    seen = []

    def function(early, late):
        jax.debug.callback(lambda value: seen.append(float(value)), early)
        return late + early

    stages = Stages(function, jnp.float32(1.0), jnp.float32(2.0))
    first = stages.run(0, [], jnp.float32(1.0))
    assert seen == []
    assert float(stages.run(1, [first], jnp.float32(2.0))) == 3.0
    jax.effects_barrier()
    assert seen == [1.0]
