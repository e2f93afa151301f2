"""Whether chance plays a part in a problem."""

import logging
import time
from typing import Any

import numpy as np

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.random_actions import RandomActions

logger = logging.getLogger(__name__)

# laws of one value, by their names
_CERTAIN = ("KronDelta", "DiracDelta")


def has_draws(model: Any) -> bool:
    """Whether some fluent is drawn at random, even if its law has one value by its parameters.

    Args:
      model: pyRDDLGym's lifted model.
    """
    return any(map(draws, _expressions(model)))


def _expressions(model: Any) -> list[Any]:
    return [model.reward, *(expression for _, expression in model.cpfs.values())]


def draws(expression: Any) -> bool:
    """Whether an expression of pyRDDLGym's, or one of several, draws from a law of more values."""
    if isinstance(expression, (tuple, list)):
        return any(map(draws, expression))
    if not hasattr(expression, "etype"):
        return False
    kind, name = expression.etype
    is_draw = kind in ("randomvar", "randomvector") and name not in _CERTAIN
    return is_draw or draws(expression.args)


def rewards_are_certain(problem: Problem, seconds: float) -> bool:
    """Whether the same random actions have the same rewards in two episodes, drawn otherwise.

    Args:
      problem: the parsed problem; its state is observed.
      seconds: what the episodes may take; if they take longer, or raise an error, nothing is
        certain.
    """
    until = time.monotonic() + seconds
    try:
        actions, rng = RandomActions(problem), np.random.default_rng(0)
        envs = [make_environment(problem) for _ in range(2)]
        state, _ = [env.reset(seed=seed)[0] for seed, env in enumerate(envs)]
        while time.monotonic() < until:
            action = actions.draw(state, rng)
            (state, reward, *_), (_, other, *_) = [env.step(action) for env in envs]
            ended, other_ended = (env.done for env in envs)
            if reward != other or ended != other_ended:
                return False
            if ended:
                return True
    except Exception as error:  # whoever plays the result will hear of it
        logger.info("two episodes of random actions failed: %s", one_line_cause(error))
    return False
