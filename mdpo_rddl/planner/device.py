"""Which device suits a problem, where there is more than the CPU."""

import logging
from typing import Any

import jax

from mdpo_rddl.machine.device import chosen_device
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.sizes import step_values

logger = logging.getLogger(__name__)

MANY_VALUES = 50_000
"""Of the model's expressions at a step: so many make up for what other devices cost
(`results/devices`)."""


def fitting_device(problem: Problem) -> Any:
    """The device for rollouts of the problem, as `computing_on` takes it.

    A step of a rollout is a few dozen small operations. An accelerator takes some microseconds to
    begin each, whatever its size, and its programs take longer to compile. What
    `jax.default_device` or JAX_PLATFORMS says stands.

    Args:
      problem: parsed.
    """
    chosen, first = chosen_device(), jax.devices()[0]
    if chosen is not None or jax.config.values["jax_platforms"] or first.platform == "cpu":
        return chosen
    values = step_values(problem.model.ast)
    if values >= MANY_VALUES:
        logger.info("%s: %d values a step: on %s", problem.label, values, first)
        return chosen
    logger.info("%s: %d values a step, too few for %s", problem.label, values, first)
    return jax.devices("cpu")[0]
