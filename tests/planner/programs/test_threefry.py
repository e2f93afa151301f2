"""The written-out hash: JAX's bits, whatever is drawn and however keys are handled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import assert_same_bits
from jax import lax, random

from mdpo_rddl.planner.programs import threefry
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.programs.threefry import threefry_2x32

KEY = random.PRNGKey(7)

DRAWS = {
    "normal": lambda key: random.normal(key, (5, 3)),
    "uniform": lambda key: random.uniform(key, (7,)),
    "bits": lambda key: random.bits(key, (5,), "uint8"),
    "long bits": lambda key: random.bits(key, (2, 3), "uint32"),
    "split": lambda key: random.split(key, 4),
    "fold_in": lambda key: random.fold_in(key, 9),
    "split, then drawn": lambda key: [random.exponential(k, (2,)) for k in random.split(key)],
    "gumbel": lambda key: random.gumbel(key, (4,)),
    "randint": lambda key: random.randint(key, (6,), 0, 100),
    "bernoulli": lambda key: random.bernoulli(key, 0.3, (9,)),
    "categorical": lambda key: random.categorical(key, jnp.arange(4.0), shape=(6,)),
    "a key with a type": lambda key: random.normal(random.wrap_key_data(key), (3,)),
}


def program_of(function):
    return str(jax.make_jaxpr(function)(KEY))


@pytest.mark.parametrize("name", DRAWS)
def test_what_is_drawn_is_the_same(name):
    fast = with_fast_random_numbers(DRAWS[name])
    assert_same_bits(jax.jit(fast)(KEY), jax.jit(DRAWS[name])(KEY))
    assert "written out" in program_of(fast) or "fryw" in program_of(fast)


def test_so_it_is_over_a_batch_of_keys():
    keys = random.split(KEY, 6)
    draw = DRAWS["split, then drawn"]
    fast = jax.jit(jax.vmap(with_fast_random_numbers(draw)))(keys)
    assert_same_bits(fast, jax.jit(jax.vmap(draw))(keys))


def test_a_loop_that_carries_a_key_keeps_jax_s_function():
    draw = DRAWS["normal"]

    def carried(key):
        def turn(_, key):
            return random.split(key, 1)[0]

        return draw(lax.fori_loop(0, 3, turn, random.wrap_key_data(key)))

    fast = with_fast_random_numbers(carried)
    (loop,) = [e for e in jax.make_jaxpr(fast)(KEY).eqns if e.primitive.name in ("scan", "while")]
    assert "fryw" not in str(loop)
    assert_same_bits(jax.jit(fast)(KEY), jax.jit(carried)(KEY))


def test_what_rejects_and_draws_again_does_too():
    fast = with_fast_random_numbers(lambda key: random.poisson(key, 3.0, (50,)))
    np.testing.assert_array_equal(fast(KEY), random.poisson(KEY, 3.0, (50,)))


def test_other_devices_have_kernels_of_their_own(monkeypatch):
    monkeypatch.setattr(threefry, "is_on_cpu", lambda: False)
    assert "fryw" not in program_of(with_fast_random_numbers(DRAWS["normal"]))


def test_the_hash_s_published_vectors():
    # Random123's known answers for threefry2x32 with 20 rounds
    def words(*values):
        return tuple(jnp.uint32(value) for value in values)

    for key, block, expected in (
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ):
        assert tuple(map(int, threefry_2x32(words(*key), words(*block)))) == expected
