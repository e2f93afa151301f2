"""Standard normal numbers in a fraction of the time that JAX takes for them on a CPU.

JAX makes a normal number of a uniform one by the inverse error function, in the approximation
of Giles 2012, "Approximating the erfinv function" (GPU Computing Gems, Jade edition, chapter 10):
a polynomial in w = -log(1 - x^2). It takes log1p(-x^2), on which the time goes on CPUs.
log((1 - x) (1 + x)) is several times as fast there, and exact in the tails, where x^2 is rounded.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

# highest power first; of w - 2.5 where w < 5, of sqrt(w) - 3 in the tails
_CENTRE = (
    2.81022636e-08,
    3.43273939e-07,
    -3.5233877e-06,
    -4.39150654e-06,
    0.00021858087,
    -0.00125372503,
    -0.00417768164,
    0.246640727,
    1.50140941,
)
_TAILS = (
    -0.000200214257,
    0.000100950558,
    0.00134934322,
    -0.00367342844,
    0.00573950773,
    -0.0076224613,
    0.00943887047,
    1.00167406,
    2.83297682,
)


def standard_normal(key: Array, shape: tuple[int, ...], dtype: jnp.dtype) -> Array:
    """The numbers of `jax.random.normal`, to within 3e-5, which is its error in the tails.

    In any precision but single they are the same numbers.

    Args:
      key: random key.
      shape: of the result.
      dtype: floating type of the result.
    """
    if dtype != jnp.float32:
        return jax.random.normal(key, shape, dtype)
    above_minus_one = np.nextafter(np.float32(-1), np.float32(0))
    uniform = jax.random.uniform(key, shape, dtype, above_minus_one, 1.0)
    return np.float32(np.sqrt(2)) * inverse_erf(uniform)


def inverse_erf(x: Array) -> Array:
    """The inverse error function of numbers between -1 and 1, both excluded, in float32."""
    w = -jnp.log((1.0 - x) * (1.0 + x))
    central = w < 5.0
    w = jnp.where(central, w - 2.5, jnp.sqrt(w) - 3.0)
    result = jnp.zeros_like(x)
    for centre, tail in zip(_CENTRE, _TAILS, strict=True):
        result = result * w + jnp.where(central, np.float32(centre), np.float32(tail))
    return result * x
