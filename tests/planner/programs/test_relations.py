"""Reductions over pairs of which few are related."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.planner.programs.relations import among_related

N, M = 40, 50
RANDOM = np.random.default_rng(0)
RELATED = np.zeros((N, M), bool)
RELATED[np.arange(N), RANDOM.integers(M, size=N)] = True
RELATED[:5, 7] = True
FIRST = np.zeros((N, M), bool)
FIRST[:, 0] = True
ON = jnp.asarray(RANDOM.random(M) < 0.5)
OFF = jnp.asarray(RANDOM.random(N) < 0.5)
NUMBERS = jnp.asarray(RANDOM.normal(size=M), jnp.float32)
BATCH = jnp.asarray(RANDOM.random((3, M)) < 0.5)


def pairs(values, axis, shape=(N, M)):
    return jax.lax.broadcast_in_dim(values, shape, (axis,))


def triples(values, axis):
    return pairs(values, axis, (N, M, N))


PROGRAMS = {
    "exists": lambda: jnp.any(RELATED & pairs(ON, 1), axis=1),
    "exists over both": lambda: jnp.any(RELATED & pairs(ON, 1) & pairs(OFF, 0)),
    "over the other axis": lambda: jnp.any(RELATED & pairs(OFF, 0) & pairs(ON, 1), axis=0),
    "for all": lambda: jnp.all(~RELATED | pairs(ON, 1), axis=1),
    "no pair": lambda: jnp.all(~(RELATED & pairs(ON, 1)), axis=1),
    "absorbed": lambda: jnp.all(RELATED & pairs(ON, 1), axis=1),
    "absorbed for some": lambda: jnp.any(RELATED & (FIRST | pairs(ON, 1)), axis=1),
    "counted": lambda: jnp.sum(RELATED & pairs(ON, 1), axis=1),
    "summed": lambda: jnp.sum(jnp.where(RELATED, pairs(NUMBERS, 1), 0.0), axis=1),
    "multiplied": lambda: jnp.prod(
        jnp.where(RELATED & pairs(ON, 1), 0.5, 1.0) * jnp.where(RELATED, 1.0, 1.0), axis=1
    ),
    "of what is compared": lambda: jnp.sum(RELATED * 1.0 * (pairs(NUMBERS, 1) > 0.5), axis=1),
    "transposed": lambda: jnp.any(jnp.transpose(RELATED & pairs(ON, 1)), axis=0),
    "of none": lambda: jnp.sum(jnp.where(RELATED & ~RELATED, pairs(NUMBERS, 1), 0.0), axis=1),
    "of constants": lambda: jnp.any(RELATED & FIRST, axis=1) & OFF,
    "three axes": lambda: jnp.any(
        jax.lax.broadcast_in_dim(RELATED, (N, M, N), (0, 1))
        & jax.lax.broadcast_in_dim(RELATED.T, (N, M, N), (1, 2))
        & triples(ON, 1)
        & triples(OFF, 2),
        axis=(1, 2),
    ),
    "all related": lambda: jnp.any(pairs(ON, 1) & pairs(OFF, 0), axis=1),
    "used twice": lambda: (RELATED & pairs(ON, 1), jnp.any(RELATED & pairs(ON, 1), axis=1)),
    "a matrix of the state": lambda: jnp.any(RELATED & jnp.outer(OFF, ON), axis=1),
    "nested": lambda: jax.jit(lambda on: jnp.any(RELATED & pairs(on, 1), axis=1))(ON),
    "side by side": lambda: jnp.any(
        jnp.concatenate([RELATED & pairs(ON, 1), FIRST[:, :20] & pairs(ON[:20], 1, (N, 20))], 1), 1
    ),
    "two at once": lambda: jax.vmap(lambda on: jnp.any(RELATED & pairs(on, 1) & pairs(OFF, 0), 1))(
        BATCH
    ),
}
LARGE = {"all related", "used twice", "side by side"}


def traced(name):
    """The program with the state as arguments, the relations as constants."""

    def program(on, off, numbers, batch):
        names = ("ON", "OFF", "NUMBERS", "BATCH")
        with pytest.MonkeyPatch.context() as patch:
            for each, value in zip(names, (on, off, numbers, batch), strict=True):
                patch.setitem(globals(), each, value)
            return PROGRAMS[name]()

    return jax.make_jaxpr(program)(ON, OFF, NUMBERS, BATCH)


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_results_are_the_same_and_the_pairs_are_gone(name):
    program = traced(name)
    related = among_related(program)
    given = ON, OFF, NUMBERS, BATCH
    expected = jax.extend.core.jaxpr_as_fun(program)(*given)
    found = jax.extend.core.jaxpr_as_fun(related)(*given)
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)
    sizes = [v.aval.size for equation in related.jaxpr.eqns for v in equation.outvars]
    assert (max(sizes, default=0) >= N * M) == (name in LARGE)


def test_a_product_with_what_may_be_infinite_is_not_left_out():
    program = jax.make_jaxpr(lambda x: jnp.sum(RELATED * pairs(x, 1), axis=1))(NUMBERS)
    infinite = NUMBERS.at[0].set(jnp.inf)
    (found,) = jax.extend.core.jaxpr_as_fun(among_related(program))(infinite)
    assert np.isnan(found).any()


def test_a_program_without_large_reductions_is_returned_as_it_is():
    program = jax.make_jaxpr(lambda x: jnp.sum(jnp.ones((3, M)) * x, axis=1))(NUMBERS)
    assert among_related(program) is program


def test_a_relation_that_is_given_is_not_a_constant():
    program = jax.make_jaxpr(lambda r, on: jnp.any(r & pairs(on, 1), axis=1))(RELATED, ON)
    related = among_related(program)
    other = jnp.asarray(~RELATED)
    (found,) = jax.extend.core.jaxpr_as_fun(related)(other, ON)
    np.testing.assert_array_equal(found, jnp.any(other & ON, axis=1))
