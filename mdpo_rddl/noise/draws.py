"""Random perturbations with a given profile."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
from jax import Array

from mdpo_rddl.actions import ActionKind, ActionSpec


def unit_noise(key: Array, kind: ActionKind, shape: tuple[int, ...], dtype: jnp.dtype) -> Array:
    """Noise of scale 1: standard normal, for bools standard logistic (scale 1, not deviation 1).

    The logistic law makes a perturbed log-odds a binary concrete variable (Maddison et al.
    2017, https://arxiv.org/abs/1611.00712).
    """
    if kind is ActionKind.BOOL:
        return jax.random.logistic(key, shape, dtype)
    return jax.random.normal(key, shape, dtype)


def draw_perturbation(
    key: Array,
    sigma: Array,
    specs: Mapping[str, ActionSpec],
    batch_size: int,
    dtype: jnp.dtype,
) -> dict[str, Array]:
    """Independent noise for each rollout, step and action component, scaled per step.

    Args:
      key: random key, used for this draw alone.
      sigma: scale per step [H], in the unit of the raw action.
      specs: the fluents to perturb.
      batch_size: number of rollouts B.
      dtype: floating type of the model.

    Returns:
      Per fluent, sigma_t times unit noise [B, H, *action shape].
    """
    horizon = sigma.shape[0]
    keys = jax.random.split(key, len(specs))
    perturbation = {}
    for subkey, (name, spec) in zip(keys, sorted(specs.items()), strict=True):
        unit = unit_noise(subkey, spec.kind, (batch_size, horizon, *spec.shape), dtype)
        scale = jnp.reshape(sigma.astype(dtype), (1, horizon) + (1,) * len(spec.shape))
        perturbation[name] = scale * unit
    return perturbation


def zero_perturbation(
    horizon: int, specs: Mapping[str, ActionSpec], batch_size: int, dtype: jnp.dtype
) -> dict[str, Array]:
    """The perturbation [B, H, *action shape] per fluent that changes nothing."""
    return {
        name: jnp.zeros((batch_size, horizon, *spec.shape), dtype) for name, spec in specs.items()
    }
