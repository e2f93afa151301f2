"""Random sums of products, as a compiler of RDDL writes them, against einsum."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mdpo_rddl.planner.programs.contraction import contract

SIZES = {"i": 23, "j": 19, "k": 11}
WHOLE = "ijk"
SHAPE = tuple(SIZES.values())
AXES = st.sets(st.sampled_from(WHOLE), min_size=0, max_size=2).map(sorted).map("".join)
TERMS = st.lists(
    st.tuples(st.sampled_from([1.0, -1.0]), st.lists(AXES, min_size=1, max_size=3)),
    min_size=1,
    max_size=3,
)


def numbers(seed, axes):
    sizes = [SIZES[axis] for axis in axes]
    return np.random.default_rng(seed).normal(size=sizes).astype(np.float32)


def as_written(terms, summed):
    """Every factor over all objects, multiplied, added up, and summed."""
    places = [WHOLE.index(axis) for axis in summed]

    def program(*factors):
        left = iter(factors)
        total = None
        for sign, product in terms:
            value = None
            for axes in product:
                dimensions = [WHOLE.index(axis) for axis in axes]
                factor = jax.lax.broadcast_in_dim(next(left), SHAPE, dimensions)
                value = factor if value is None else value * factor
            value = -value if sign < 0 else value
            total = value if total is None else total + value
        return jnp.sum(total, axis=places)

    return program


@settings(max_examples=15)
@given(TERMS, st.sets(st.sampled_from(WHOLE), min_size=1), st.integers(0, 2**31))
def test_random_equations_are_those_of_einsum(terms, summed, seed):
    kept = "".join(axis for axis in WHOLE if axis not in summed)
    factors, expected, largest = [], 0.0, 0.0
    for sign, product in terms:
        values = [numbers(seed + len(factors) + n, axes) for n, axes in enumerate(product)]
        factors += values
        # a factor of ones for what no other factor has
        whole = [*(v.astype(np.float64) for v in values), np.ones(SHAPE)]
        subscripts = f"{','.join([*product, WHOLE])}->{kept}"
        expected = expected + sign * np.einsum(subscripts, *whole)
        largest = largest + np.einsum(subscripts, *map(np.abs, whole))
    program = jax.make_jaxpr(as_written(terms, summed))(*factors)
    shorter = contract(program)
    (found,) = jax.extend.core.jaxpr_as_fun(shorter)(*factors)
    assert found.shape == expected.shape
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.max(largest))
    # only where a product covers all axes, or all is numbers, is anything of that size computed
    covered = [len(set("".join(product))) for _, product in terms]
    if 0 < max(covered) < 3:
        sizes = [out.aval.size for each in shorter.jaxpr.eqns for out in each.outvars]
        assert max(sizes, default=0) < np.prod(SHAPE)
