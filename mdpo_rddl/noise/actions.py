"""What the noise and the projection must know of an action fluent: kind, shape and box."""

import enum
from dataclasses import dataclass, field

import numpy as np


class ActionKind(enum.Enum):
    """How an action fluent is relaxed, which decides the law of its noise."""

    REAL = "real"
    INTEGER = "integer"  # int and enum fluents: real-valued in the relaxed model
    BOOL = "bool"  # a probability in (0, 1) in the relaxed model
    CHOICE = "choice"  # bools that share a softmax or top-k, since few of them may be true


@dataclass(frozen=True)
class ActionSpec:
    """One action fluent.

    Attributes:
      name: the lifted fluent's name.
      shape: shape of the fluent's tensor, one axis per RDDL parameter; () if it has none.
      kind: which decides the law of its noise.
      lower: lower bounds [*shape], -inf where there is none; unused for bools and choices.
      upper: upper bounds [*shape], inf where there is none; unused likewise.
      squashed: whether the plan squashes raw values into the box instead of clipping them.
      unit: what a noise of scale 1 means [*shape]; 1 for plans without units of their own.
      of_model: whether a perturbation is of the action that the model sees, so that it is
        divided by the squashing function's slope; else of the raw action.
    """

    name: str
    shape: tuple[int, ...]
    kind: ActionKind
    lower: np.ndarray
    upper: np.ndarray
    squashed: bool = False
    unit: np.ndarray = field(default_factory=lambda: np.ones(()))
    of_model: bool = False
