"""What a policy reads at the objects that the state names, and in which units."""

from collections.abc import Mapping, Sequence

import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.lookups import Lookups, lookups

# of the states that constants have seen; and of what is read, each with a few weights
_STATES, _MOST = 256, 16
# what counts as a constant, and as the same number in other units
_LEAST_SPREAD, _LEAST_CORRELATION = 1e-6, 0.999
_OF_BOOLS = (0.5, 0.5)


def lookup_scales(
    planner: MDPOPlanner,
    states: Mapping[str, Sequence[np.ndarray]],
    state_scales: Mapping[str, tuple[float, float]],
) -> dict[str, tuple[float, float]]:
    """Centre and scale of lookups that are news, 16 at most.

    They change with the state, and no observed fluent, or another one of them, says the same in
    other units.

    Args:
      planner: of the problem.
      states: per observed fluent arrays of values that were seen [P, N, steps, *shape].
      state_scales: per observed fluent its centre and scale, which are also those of what is
        looked up in it.
    """
    rddl, found = planner.rddl, dict[str, tuple[float, float]]()
    chosen = lookups(rddl)
    if not chosen:
        return found
    seen = {
        name: np.concatenate([each.reshape(-1, *each.shape[3:]) for each in batches])
        for name, batches in states.items()
    }
    places = np.random.default_rng(0).permutation(len(next(iter(seen.values()))))[:_STATES]
    some = {name: each[places] for name, each in seen.items()}
    look = Lookups(rddl, planner.test_compiled.init_values, list(chosen))
    rows = [look({name: each[row] for name, each in some.items()}) for row in range(len(places))]
    known = [each.astype(float) for each in some.values() if np.isfinite(each).all()]
    for name, lookup in chosen.items():
        values = np.stack([row[name] for row in rows]).astype(float)
        if len(found) == _MOST or not _varies(values):
            continue
        if any(_is_same(values, other) for other in known):
            continue
        known.append(values)
        if rddl.variable_ranges[lookup.fluent] == "bool":
            found[name] = _OF_BOOLS
        else:
            usual = float(np.mean(values)), float(np.std(values))
            found[name] = state_scales.get(lookup.fluent, usual)
    return found


def _varies(values: np.ndarray) -> bool:
    """Whether values [N, *shape] are finite and differ between the states."""
    if not np.isfinite(values).all():
        return False
    size = max(1.0, float(np.max(np.abs(values), initial=0.0)))
    return bool(np.any(np.std(values, axis=0) > _LEAST_SPREAD * size))


def _is_same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether one [N, *shape] changes as the other does, in other units."""
    if one.shape != other.shape:
        return False
    changes = [(each - each.mean(axis=0)).ravel() for each in (one, other)]
    if not all(map(np.any, changes)):
        return False
    return bool(abs(np.corrcoef(*changes)[0, 1]) > _LEAST_CORRELATION)
