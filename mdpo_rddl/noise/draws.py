"""Random perturbations with a given profile."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.noise.actions import ActionKind, ActionSpec
from mdpo_rddl.noise.normal import standard_normal


def unit_noise(key: Array, kind: ActionKind, shape: tuple[int, ...], dtype: jnp.dtype) -> Array:
    """Noise of scale 1: normal, for bools logistic, for choices Gumbel.

    The scale of the normal law is its standard deviation; the logistic and the Gumbel law's
    is their usual parameter (deviations pi / sqrt(3) and pi / sqrt(6)). On log-odds and
    logits these laws make binary concrete and concrete (Gumbel-softmax) variables: Maddison
    et al. 2017, https://arxiv.org/abs/1611.00712; Jang et al. 2017,
    https://arxiv.org/abs/1611.01144.
    """
    if kind is ActionKind.BOOL:
        return jax.random.logistic(key, shape, dtype)
    if kind is ActionKind.CHOICE:
        return jax.random.gumbel(key, shape, dtype)
    return standard_normal(key, shape, dtype)


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
      sigma: scale per step [H], in each fluent's unit.
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
        if np.any(spec.unit != 1.0):
            scale = scale * jnp.asarray(spec.unit, dtype)
        perturbation[name] = scale * unit
    return perturbation


def zero_perturbation(
    horizon: int, specs: Mapping[str, ActionSpec], batch_size: int, dtype: jnp.dtype
) -> dict[str, Array]:
    """The perturbation [B, H, *action shape] per fluent that changes nothing."""
    return {
        name: jnp.zeros((batch_size, horizon, *spec.shape), dtype) for name, spec in specs.items()
    }
