"""What an environment shows of a state, and whether it shows it yet."""

from typing import Any

import numpy as np


def is_observed(value: Any) -> bool:
    """Whether an observed tensor holds values.

    A partially observed problem shows nothing before the first step: pyRDDLGym then gives None
    for each observation fluent, or an array of objects that holds None.
    """
    return value is not None and np.asarray(value).dtype != object
