"""What an environment shows of a state, and whether it shows it yet."""

from typing import Any

import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel


def is_observed(value: Any) -> bool:
    """Whether an observed tensor holds values.

    A partially observed problem shows nothing before the first step: pyRDDLGym then gives None
    for each observation fluent, or an array of objects that holds None.
    """
    return value is not None and np.asarray(value).dtype != object


def as_numbers(model: RDDLLiftedModel, name: str, values: Any) -> np.ndarray:
    """What an environment shows of a fluent as numbers: places of objects for their names.

    Args:
      model: the problem's, lifted.
      name: of the fluent.
      values: numbers, bools or names of objects [*shape].
    """
    values = np.asarray(values)
    if values.dtype.kind != "U":
        return values
    return np.asarray(model.object_string_to_index_array(model.variable_ranges[name], values))
