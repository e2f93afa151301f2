"""Normal numbers: those that JAX draws, and nearer to the exact law."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special

from mdpo_rddl.noise.normal import inverse_erf, standard_normal

KEY = jax.random.PRNGKey(5)
SHAPE = (200_000,)


def test_normal_numbers_are_those_of_jax():
    own, theirs = standard_normal(KEY, SHAPE, jnp.float32), jax.random.normal(KEY, SHAPE)
    np.testing.assert_allclose(own, theirs, rtol=0, atol=3e-5)


@pytest.mark.parametrize("dtype", [jnp.float16, jnp.bfloat16])
def test_other_precisions_are_left_to_jax(dtype):
    own, theirs = standard_normal(KEY, SHAPE, dtype), jax.random.normal(KEY, SHAPE, dtype)
    assert own.dtype == dtype
    np.testing.assert_array_equal(own, theirs)


def test_the_inverse_error_function_is_exact_to_single_precision():
    near_one = 1.0 - 2.0 ** -np.arange(1.0, 25.0)
    x = np.concatenate([np.linspace(-0.999, 0.999, 100_001), near_one, -near_one])
    x = x.astype(np.float32)
    exact = special.erfinv(x.astype(np.float64))
    np.testing.assert_allclose(inverse_erf(x), exact, rtol=4e-7)
    # JAX's own is further off
    assert np.abs(jax.lax.erf_inv(x) - exact).max() > 1e-5
