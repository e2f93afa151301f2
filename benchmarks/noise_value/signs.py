"""What a user can see of a problem and of a training without noise."""

from collections.abc import Mapping

import numpy as np

from benchmarks.noise_value.lanes import Trained
from mdpo_rddl.noise.actions import ActionKind
from mdpo_rddl.planner.planner import MDPOPlanner

_LOGITS = (ActionKind.BOOL, ActionKind.CHOICE)

SIGNS: Mapping[str, str] = {
    "flat_start": "share of the steps whose sensitivity is 0 at the first iteration",
    "flat": "share of the steps whose sensitivity is 0, mean over the iterations",
    "last_improved": "share of the iterations after which training without noise improves no more",
    "gap": "distance of the train return from the test return, as a share of the larger one",
    "gain": "gain of the test return without noise, as a share of the first one",
    "batch": "training batch",
    "pgpe": "PGPE is on",
    "drp": "the plan is a deep reactive policy",
    "reals": "share of the action fluents that are real",
    "clipped": "an action fluent has a box",
}
"""Per sign what it is: a number that is the same for all methods."""


def signs(planner: MDPOPlanner, plain: Trained) -> dict[str, float]:
    """The values of `SIGNS`, means over the seeds.

    Args:
      planner: of the cell.
      plain: the training without noise.
    """
    specs = planner.action_specs.values()
    size = np.maximum(np.abs(plain.first), 1e-12)
    boxed = [np.isfinite(s.lower).any() or np.isfinite(s.upper).any() for s in specs]
    values = {
        "flat_start": np.mean(plain.flat_start),
        "flat": np.mean(plain.flat),
        "last_improved": np.mean(plain.last_improved),
        "gap": np.mean(plain.gap),
        "gain": np.mean(np.minimum(10.0, (plain.best - plain.first) / size)),
        "batch": planner.batch_size_train,
        "pgpe": planner.use_pgpe,
        "drp": "Reactive" in type(planner.plan).__name__,
        "reals": np.mean([spec.kind is ActionKind.REAL for spec in specs]),
        "clipped": any(b for b, s in zip(boxed, specs, strict=True) if s.kind not in _LOGITS),
    }
    return {name: float(values[name]) for name in SIGNS}
