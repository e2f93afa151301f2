"""What a noise of scale 1 means for each action component."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from mdpo_rddl.noise.actions import ActionKind, ActionSpec

ABSOLUTE, RANGE = "absolute", "range"
UNITS = (ABSOLUTE, RANGE)


def require_unit(unit: object) -> None:
    """Checks the name of a unit.

    Raises:
      ValueError: if it is not one of `UNITS`.
    """
    if unit not in UNITS:
        raise ValueError(f"unit must be {' or '.join(map(repr, UNITS))}, got {unit!r}")


def box_widths(spec: ActionSpec) -> np.ndarray:
    """Upper minus lower bound [*shape]; inf where one is missing, 1 where both are the same."""
    widths = np.asarray(spec.upper, np.float64) - np.asarray(spec.lower, np.float64)
    return np.where(widths > 0.0, widths, 1.0)


def has_box(spec: ActionSpec) -> bool:
    """Whether every component is bounded on both sides, has a unit of the plan's, or is a bool."""
    if spec.kind in (ActionKind.BOOL, ActionKind.CHOICE):
        return True
    return bool(np.all(np.isfinite(box_widths(spec)) | (spec.unit != 1.0)))


def in_range_units(
    specs: Mapping[str, ActionSpec], scales: Mapping[str, float]
) -> dict[str, ActionSpec]:
    """The fluents with a unit for each component that fits its range.

    The unit is the width of the box. Where the box has no width, because a bound is missing, it
    is the plan's own unit if that is not 1, else the fluent's entry of `scales`. For bools and
    choices it is 1, the scale of the logistic or Gumbel law on their log-odds or logits.

    Args:
      specs: the fluents that take noise, as the plan has them.
      scales: per fluent the size at which the return answers to the action; 1 if not named.
    """
    return {name: _in_range_units(spec, scales.get(name, 1.0)) for name, spec in specs.items()}


def _in_range_units(spec: ActionSpec, scale: float) -> ActionSpec:
    if spec.kind in (ActionKind.BOOL, ActionKind.CHOICE):
        return spec
    widths = box_widths(spec)
    own = np.broadcast_to(spec.unit, spec.shape)
    unbounded = np.where(own != 1.0, own, scale)
    unit = np.where(np.isfinite(widths), widths, unbounded)
    return dataclasses.replace(spec, unit=unit, of_model=True)
