"""What a policy reads at the objects that the state names, and in which units."""

from collections.abc import Mapping, Sequence

import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.lookups import Lookups, lookups

# of the states that constants have seen
_STATES = 256
# what counts as a constant, and as the same number in other units
_LEAST_SPREAD, _LEAST_CORRELATION = 1e-6, 0.999


def lookup_scales(
    planner: MDPOPlanner, states: Mapping[str, Sequence[np.ndarray]]
) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of lookups that are news.

    They change with the state, and no observed fluent, or another one of them, says the same in
    other units.

    Args:
      planner: of the problem.
      states: per observed fluent arrays of values that were seen [P, N, steps, *shape].
    """
    if not (names := list(lookups(planner.rddl))):
        return {}
    seen = {
        name: np.concatenate([each.reshape(-1, *each.shape[3:]) for each in batches])
        for name, batches in states.items()
    }
    places = np.random.default_rng(0).permutation(min(map(len, seen.values())))[:_STATES]
    some = {name: each[places] for name, each in seen.items()}
    look = Lookups(planner.rddl, planner.test_compiled.init_values, names)
    rows = [look({name: each[row] for name, each in some.items()}) for row in range(len(places))]
    known, found = [each.astype(float) for each in some.values()], {}
    for name in names:
        each = np.stack([row[name] for row in rows]).astype(float)
        if _varies(each) and not any(_is_same(each, other) for other in known):
            known.append(each)
            found[name] = float(np.mean(each)), float(np.std(each))
    return found


def _varies(values: np.ndarray) -> bool:
    """Whether values [N, *shape] are finite and differ between the states."""
    if not np.isfinite(values).all():
        return False
    size = max(1.0, float(np.max(np.abs(values), initial=0.0)))
    return bool(np.any(np.std(values, axis=0) > _LEAST_SPREAD * size))


def _is_same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether one is the other in other units."""
    if one.shape != other.shape or not (np.std(one) and np.std(other)):
        return False
    return bool(abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) > _LEAST_CORRELATION)
