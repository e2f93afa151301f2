"""`enable_x64` by the name that the installed version of JAX has for it."""

try:
    from jax import enable_x64
except ImportError:  # before JAX 0.8
    from jax.experimental import enable_x64

__all__ = ["enable_x64"]
