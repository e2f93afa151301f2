"""Noise on bools whose number of true values `max-nondef-actions` limits.

JaxPlan keeps the limit inside its policies, by a softmax or top-k over logits, or by
projecting a plan's parameters. The noise has to enter ahead of that, so it is added to the
parameter that the logits are made of; JaxPlan's projection then follows by itself.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from mdpo_rddl.noise.projection import shift_logit
from mdpo_rddl.planner.upstream import JaxDeepReactivePolicy, JaxPlan, JaxStraightLinePlan

Shift = Callable[[Any, Mapping[str, Any], Any, Mapping[str, Array]], tuple[Any, Any]]
"""(parameters, hyperparameters, step, perturbation per bool fluent [*shape]) -> the parameters
and the step to call the plan's policy with."""


def shift_jaxplan(plan: JaxPlan, names: Sequence[str]) -> Shift | None:
    """How to perturb the limited bools of a compiled plan of JaxPlan's own; else None.

    With Gumbel noise on its logits a softmax is a concrete (Gumbel-softmax) variable:
    Maddison et al. (2017), https://arxiv.org/abs/1611.00712, and Jang et al. (2017),
    https://arxiv.org/abs/1611.01144, at temperature 1 with the noise scaled by sigma.
    """
    if isinstance(plan, JaxDeepReactivePolicy):
        return _shift_network(names)
    if isinstance(plan, JaxStraightLinePlan):
        if plan._wrap_softmax:
            return _shift_softmax_plan(names)
        return _shift_projected_plan(plan, names)
    return None


def _concatenated(names: Sequence[str], perturbation: Mapping[str, Array]) -> Array:
    return jnp.concatenate([jnp.ravel(perturbation[name]) for name in names])


def _shift_network(names: Sequence[str]) -> Shift:
    """A shift of the output layer's bias is a shift of the logits."""

    def shift(params, hyperparams, step, perturbation):
        del hyperparams
        layers = dict(params["params"])
        output = dict(layers["output_bool"])
        output["bias"] = output["bias"] + _concatenated(names, perturbation)
        layers["output_bool"] = output
        return {**params, "params": layers}, step

    return shift


def _slice(params: Mapping[str, Array], step: Any) -> dict[str, Array]:
    """A plan of one step: perturbing the whole plan at every step would cost H times as much."""
    return {name: param[step][jnp.newaxis] for name, param in params.items()}


def _shift_softmax_plan(names: Sequence[str]) -> Shift:
    def shift(params, hyperparams, step, perturbation):
        del hyperparams
        one = _slice(params, step)
        one["bool__"] = one["bool__"] + _concatenated(names, perturbation)
        return one, 0

    return shift


def _shift_projected_plan(plan: JaxStraightLinePlan, names: Sequence[str]) -> Shift:
    """Shifts the log-odds, then applies the plan's own projection to that step.

    The projection is an iteration without a derivative; its correction is taken as constant,
    as in JaxPlan's projected gradient steps.
    """

    def shift(params, hyperparams, step, perturbation):
        one = _slice(params, step)
        for name in names:
            if plan._wrap_sigmoid:  # the parameter times a weight is the log-odds
                one[name] = one[name] + perturbation[name] / hyperparams[name]
            else:
                one[name] = shift_logit(one[name], perturbation[name])
        fixed = jax.lax.stop_gradient(one)
        projected, _ = plan.projection(fixed, hyperparams)
        for name in names:
            one[name] = one[name] + (projected[name] - fixed[name])
        return one, 0

    return shift
