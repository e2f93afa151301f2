"""What an arm was given and what it did."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mdpo_rddl.planner.training.training import Record


@dataclass
class ArmLog:
    """What an arm was given and what it did.

    Attributes:
      name: the arm's.
      slices: of time that it was given.
      seconds: of all of them, preparation included.
      compile_seconds: of them, spent in compilation.
      iterations: done in all slices.
      best_return: the judge's mean return of its best candidate; None before the first.
      records: recorded iterations of training with a gradient, if it does that.
      sigma: the noise's scale per recorded iteration and step [recorded, H].
      details: what else there is to say, as JSON can hold it.
    """

    name: str
    slices: int = 0
    seconds: float = 0.0
    compile_seconds: float = 0.0
    iterations: int = 0
    best_return: float | None = None
    records: tuple[Record, ...] = ()
    sigma: np.ndarray | None = None
    details: Mapping[str, Any] = field(default_factory=dict)
