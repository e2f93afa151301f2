"""Whether chance plays a part in a problem, and whether actions have a say in it."""

import logging
import time
from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.random_actions import RandomActions

logger = logging.getLogger(__name__)

# laws of one value, by their names
_CERTAIN = ("KronDelta", "DiracDelta")
# kinds and names of what weighs or chooses one of its parts by another; and of what may do so with
# what is within one part
_WEIGHING = {
    *(("arithmetic", name) for name in "*/"),
    *(("boolean", name) for name in ("^", "&", "|", "=>", "<=>")),
    *(("control", name) for name in ("if", "switch")),
    *(("func", name) for name in ("pow", "div", "mod", "fmod")),
}
_WEIGHING_WITHIN = {
    *(("relational", name) for name in ("<", "<=", ">", ">=", "==", "~=")),
    *(("aggregation", name) for name in ("prod", "forall", "exists")),
}


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


class _Parts(NamedTuple):
    """Of an expression: whether it has actions, draws, and draws whose weight is up to actions."""

    acts: bool = False
    draws: bool = False
    weighs: bool = False


def actions_weigh_chances(model: Any) -> bool:
    """Whether an action changes how likely something is, or what a draw is worth.

    Noise that is added to what an action does is none of that: it is the same for all actions.

    Args:
      model: pyRDDLGym's lifted model.
    """
    acting, drawn, count = set(model.action_fluents), set[str](), -1
    while count < len(acting) + len(drawn):
        count = len(acting) + len(drawn)
        for name, (_, expression) in model.cpfs.items():
            parts = _parts(expression, acting, drawn)
            acting |= {name} if parts.acts else set()
            drawn |= {name} if parts.draws else set()
    return any(_parts(each, acting, drawn).weighs for each in _expressions(model))


def _parts(expression: Any, acting: Collection[str], drawn: Collection[str]) -> _Parts:
    """What is in an expression.

    Args:
      expression: of pyRDDLGym's, or several.
      acting: names of the actions, and of what depends on them.
      drawn: names of what depends on draws.
    """
    if isinstance(expression, (tuple, list)):
        return _joined([_parts(each, acting, drawn) for each in expression])
    if not hasattr(expression, "etype"):
        return _Parts()
    kind, name = expression.etype
    if kind == "pvar":
        own = _Parts(name in acting, name in drawn)
        index = _parts(expression.args[1:], acting, drawn)
        joined = _joined([own, index])
        apart = (own.acts and index.draws) or (own.draws and index.acts)
        return joined._replace(weighs=joined.weighs or apart)
    # a constant has its value there
    given = expression.args if isinstance(expression.args, (tuple, list)) else ()
    parts = [_parts(each, acting, drawn) for each in given]
    joined = _joined(parts)
    if kind in ("randomvar", "randomvector") and name not in _CERTAIN:
        return _Parts(joined.acts, True, joined.weighs or joined.acts)
    if (kind, name) in _WEIGHING:
        apart = any(
            one.acts and other.draws
            for number, one in enumerate(parts)
            for other in parts[:number] + parts[number + 1 :]
        )
        return joined._replace(weighs=joined.weighs or apart)
    if (kind, name) in _WEIGHING_WITHIN:
        return joined._replace(weighs=joined.weighs or (joined.acts and joined.draws))
    return joined


def _joined(parts: Collection[_Parts]) -> _Parts:
    return _Parts(*map(any, zip(_Parts(), *parts, strict=True)))


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
