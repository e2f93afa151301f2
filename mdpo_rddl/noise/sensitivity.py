"""How sensitive the return is to the action at each step."""

from collections.abc import Mapping

import jax.numpy as jnp
from jax import Array, lax


def step_sensitivity(gradients: Mapping[str, Array]) -> Array:
    """Mean over action fluents of the gradient's 2-norm, per step.

        s_t = (1 / M) sum_m || dJ / da_t^(m) ||_2

    (arXiv 2605.07520, appendix "Noise Extension to Multiple Action Types").

    Args:
      gradients: per fluent, the return's gradient [H, *action shape], in return per unit of
        action.

    Returns:
      s [H], in return per unit of action; not finite where a gradient is not.
    """
    norms = [_row_norms(gradient) for gradient in gradients.values()]
    return jnp.mean(jnp.stack(norms), axis=0)


def _row_norms(gradient: Array) -> Array:
    rows = jnp.reshape(gradient, (gradient.shape[0], -1))
    # a closed loop's gradient can pass 1e19, whose square overflows in 32 bit
    largest = jnp.max(jnp.abs(rows), axis=1, keepdims=True)
    scale = jnp.where(largest > 0.0, largest, 1.0)
    return jnp.squeeze(scale, axis=1) * jnp.linalg.norm(rows / scale, axis=1)


def normalised_sensitivity(sensitivity: Array, quantile: float, regularization: float) -> Array:
    """Sensitivities relative to a high quantile of theirs: clip(s / (q_p + lambda), 0, 1).

    Args:
      sensitivity: s [H].
      quantile: p in (0, 1], with linear interpolation between order statistics.
      regularization: lambda, above 0, in the unit of s.

    Returns:
      Values in [0, 1], [H]. Entries that are not finite give 0 and do not move the quantile.
    """
    finite = jnp.isfinite(sensitivity)
    ordered = _ascending(jnp.where(finite, sensitivity, jnp.inf))
    place = quantile * jnp.maximum(jnp.sum(finite) - 1, 0).astype(sensitivity.dtype)
    lower = jnp.floor(place)
    pair = ordered[lower.astype(int)], ordered[jnp.ceil(place).astype(int)]
    reference = pair[0] * (1.0 - (place - lower)) + pair[1] * (place - lower)
    reference = jnp.where(jnp.any(finite), reference, 0.0)
    relative = jnp.clip(sensitivity / (reference + regularization), 0.0, 1.0)
    return jnp.where(finite, relative, 0.0)


def _ascending(values: Array) -> Array:
    """Sorts numbers that are at least 0, through their bits: integers are sorted faster."""
    integers = jnp.int64 if values.dtype.itemsize == 8 else jnp.int32
    bits = lax.bitcast_convert_type(values, integers)
    return lax.bitcast_convert_type(lax.sort(bits, is_stable=False), values.dtype)
