"""Whether chance plays a part in a problem."""

from typing import Any

# laws of one value, by their names
_CERTAIN = ("KronDelta", "DiracDelta")


def has_draws(model: Any) -> bool:
    """Whether some fluent is drawn at random, even if its law has one value by its parameters.

    Args:
      model: pyRDDLGym's lifted model.
    """
    return any(draws(expression) for _, expression in model.cpfs.values()) or draws(model.reward)


def draws(expression: Any) -> bool:
    """Whether an expression, or one of several, draws from a law of more than one value."""
    if isinstance(expression, (tuple, list)):
        return any(map(draws, expression))
    if not hasattr(expression, "etype"):
        return False
    kind, name = expression.etype
    is_draw = kind in ("randomvar", "randomvector") and name not in _CERTAIN
    return is_draw or draws(expression.args)
