"""Numbers in files and messages that anybody may have written."""

import sys
from typing import Any, TypeGuard


def is_whole(value: Any) -> TypeGuard[int]:
    """Whether it is a whole number; true and false are none."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_count(value: Any) -> TypeGuard[int]:
    """Whether it is a whole number of at least 0."""
    return is_whole(value) and value >= 0


def is_finite(value: Any) -> TypeGuard[float]:
    """Whether it is a number that a float can hold, which infinity and NaN are not."""
    # `math.isfinite` raises an error for whole numbers that are too large
    is_number = isinstance(value, float) or is_whole(value)
    return is_number and abs(value) <= sys.float_info.max
