"""Range checks for the numbers of a noise rule."""

import dataclasses
import math
import numbers
from typing import Any


def require_number(
    name: str,
    value: object,
    *,
    at_least: float | None = None,
    above: float | None = None,
    at_most: float | None = None,
) -> None:
    """Checks one Python number.

    Tracers and arrays pass unchecked: a registered dataclass is rebuilt around them inside
    compiled functions.

    Raises:
      ValueError: if `value` is not finite or out of range, or is a bool, string or None.
    """
    if isinstance(value, bool | str) or value is None:
        raise ValueError(f"{name} must be a number, got {value!r}")
    if not isinstance(value, numbers.Real):
        return
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    if at_least is not None and number < at_least:
        raise ValueError(f"{name} must be at least {at_least:g}, got {number:g}")
    if above is not None and number <= above:
        raise ValueError(f"{name} must be above {above:g}, got {number:g}")
    if at_most is not None and number > at_most:
        raise ValueError(f"{name} must be at most {at_most:g}, got {number:g}")


def require_bool(name: str, value: object) -> None:
    """Checks one flag.

    Raises:
      ValueError: if it is not True or False.
    """
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be True or False, got {value!r}")


def floats_only(rule: Any, but: tuple[str, ...] = ()) -> None:
    """Makes the numbers of a frozen rule floats, so that 1 and 1.5 are the same type to JAX."""
    for field in dataclasses.fields(rule):
        value = getattr(rule, field.name)
        if field.name not in but and isinstance(value, numbers.Real):
            object.__setattr__(rule, field.name, float(value))
