"""Whether chance plays a part in a problem."""

from typing import Any


def has_draws(model: Any) -> bool:
    """Whether some fluent is drawn at random, even if from a law with one value.

    Args:
      model: pyRDDLGym's lifted model.
    """
    return any(draws(expression) for _, expression in model.cpfs.values()) or draws(model.reward)


def draws(expression: Any) -> bool:
    """Whether an expression, or one of several, draws at random."""
    if isinstance(expression, (tuple, list)):
        return any(map(draws, expression))
    if not hasattr(expression, "etype"):
        return False
    return expression.etype[0] in ("randomvar", "randomvector") or draws(expression.args)
