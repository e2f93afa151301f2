"""From a raw, perturbed action to one that the relaxed model accepts.

The noise must enter *before* these functions: a component that sits on its bound has no
gradient after a clip, and only a perturbation ahead of the clip restores it.
"""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
from jax import Array

from mdpo_rddl.noise.actions import ActionKind, ActionSpec

_LEAST_SLOPE = 0.1


def clip_to_box(raw: Array, spec: ActionSpec) -> Array:
    """Clips raw values [*shape], in the action's own unit, to the action's box.

    A value on a bound keeps its whole gradient (`jnp.clip` would halve it): the parameters
    of a straight-line plan sit exactly there after each projected step.
    """
    lower, upper = spec.lower.astype(raw.dtype), spec.upper.astype(raw.dtype)
    return jnp.where(raw < lower, lower, jnp.where(raw > upper, upper, raw))


def squash_to_box(raw: Array, spec: ActionSpec) -> Array:
    """Maps raw values [*shape] smoothly into the action's box, component by component.

    A sigmoid between two finite bounds, a softplus at a single one, the identity at none,
    as Bueno et al. (2019) do; raw values have no unit here.
    """
    has_lower, has_upper = jnp.isfinite(spec.lower), jnp.isfinite(spec.upper)
    lower = jnp.where(has_lower, spec.lower, 0.0).astype(raw.dtype)
    upper = jnp.where(has_upper, spec.upper, 0.0).astype(raw.dtype)
    one_sided = jnp.where(
        has_lower,
        lower + jax.nn.softplus(raw),
        jnp.where(has_upper, upper - jax.nn.softplus(-raw), raw),
    )
    return jnp.where(
        has_lower & has_upper, lower + (upper - lower) * jax.nn.sigmoid(raw), one_sided
    )


def squashing_slope(raw: Array, spec: ActionSpec) -> Array:
    """Derivative [*shape] of `squash_to_box` at `raw`, but at least a tenth of its largest.

    In a saturated component the slope goes to 0, and no shift of the raw value could be called
    small any more. A component that can only be one value counts as 1 wide, as its unit does.
    """
    has_lower, has_upper = jnp.isfinite(spec.lower), jnp.isfinite(spec.upper)
    is_wide = has_lower & has_upper & (spec.upper > spec.lower)
    width = jnp.where(is_wide, spec.upper - spec.lower, 1.0).astype(raw.dtype)
    rising, falling = jax.nn.sigmoid(raw), jax.nn.sigmoid(-raw)
    two_sided = width * jnp.maximum(rising * falling, _LEAST_SLOPE / 4.0)
    one_sided = jnp.maximum(jnp.where(has_lower, rising, falling), _LEAST_SLOPE)
    bounded = jnp.where(has_lower & has_upper, two_sided, one_sided)
    return jnp.where(has_lower | has_upper, bounded, 1.0)


def shift_logit(probability: Array, shift: Array) -> Array:
    """Adds `shift` to the log-odds of a probability: sigmoid(logit(p) + shift).

    Written without the logit, so that p = 0 and p = 1 stay finite and keep a gradient with
    respect to p. With a logistic shift this is the binary concrete relaxation of Maddison et
    al. (2017), https://arxiv.org/abs/1611.00712, with temperature 1 and the shift's scale in
    place of the unit logistic's. Shifts beyond +-40, which leave odds of less than 1e-17,
    count as +-40.
    """
    shift = jnp.clip(shift, -40.0, 40.0)  # the square of exp(-40) is still a normal number
    true = probability * jnp.exp(jnp.minimum(shift, 0.0))
    false = (1.0 - probability) * jnp.exp(-jnp.maximum(shift, 0.0))
    return true / (true + false)


def perturb_and_project(
    raw: Mapping[str, Array],
    perturbation: Mapping[str, Array],
    specs: Mapping[str, ActionSpec],
) -> dict[str, Array]:
    """The actions that the relaxed model sees: raw action plus perturbation, then projected.

    Args:
      raw: per fluent, the plan's output [*shape] before any box: in the action's unit for
        plans that clip, before the squashing function for plans that squash, and the
        probability of true for bools.
      perturbation: per fluent, what to add [*shape], for bools to the log-odds. Fluents
        without an entry keep their raw value. Where a fluent's spec says `of_model` and the plan
        squashes, it is meant in units of the squashed action, to first order: it is divided by
        the slope at the raw value, which gradients take as constant.
      specs: per perturbed fluent, its kind and box.

    Returns:
      Per fluent of `raw`, the action [*shape] within its box.
    """
    actions = dict(raw)
    for name, shift in perturbation.items():
        spec = specs[name]
        if spec.kind is ActionKind.BOOL:
            actions[name] = shift_logit(raw[name], shift)
        elif spec.squashed:
            if spec.of_model:
                # the noise's size is no way for the policy to change its return
                shift = shift / jax.lax.stop_gradient(squashing_slope(raw[name], spec))
            actions[name] = squash_to_box(raw[name] + shift, spec)
        else:
            actions[name] = clip_to_box(raw[name] + shift, spec)
    return actions


def project_and_perturb(
    raw: Mapping[str, Array],
    perturbation: Mapping[str, Array],
    specs: Mapping[str, ActionSpec],
) -> dict[str, Array]:
    """As `perturb_and_project`, but perturbs the projected action, and clips the sum to the box.

    For comparison: it gives a component that sits on its bound no gradient, however it is
    perturbed. Bools have no box, and are perturbed on their log-odds here too.
    """
    nothing = {name: jnp.zeros_like(shift) for name, shift in perturbation.items()}
    actions = perturb_and_project(raw, nothing, specs)
    for name, shift in perturbation.items():
        spec = specs[name]
        if spec.kind is ActionKind.BOOL:
            actions[name] = shift_logit(actions[name], shift)
        else:
            actions[name] = clip_to_box(actions[name] + shift, spec)
    return actions
