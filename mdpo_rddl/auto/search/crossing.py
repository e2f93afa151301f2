"""One plan of several: each object's actions from the plan in which they return most."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

Plans = Mapping[str, np.ndarray]
"""Per action fluent the actions of P plans [P, H, *shape]."""
Part = tuple[tuple[str, int | None], ...]
"""Action fluents, and which of the first object's entries; None for all of a fluent's."""

# plans that are tried, of which each takes one part from another plan
_MOST_TRIALS = 512


def parts_of(rddl: Any) -> list[Part]:
    """The actions of each object, and those about none.

    Objects are told by an action's first parameter, so that actions of the same type of object go
    together.

    Args:
      rddl: pyRDDLGym's lifted model.
    """
    found: dict[tuple[str, int | None], list[tuple[str, int | None]]] = {}
    for name in rddl.action_fluents:
        types = rddl.variable_params[name]
        places = range(len(rddl.type_to_objects[types[0]])) if types else [None]
        for place in places:
            found.setdefault((types[0] if types else "", place), []).append((name, place))
    return [tuple(entries) for entries in found.values()]


def crossed(
    plans: Plans,
    returns: np.ndarray,
    parts: Sequence[Part],
    evaluate: Callable[[Plans], np.ndarray],
) -> tuple[dict[str, np.ndarray], float]:
    """The best of the plans, with the parts of others that return more in it.

    Each part of each plan is tried alone in the best plan. Then all parts that gain are tried
    together: where objects do not bear on each other, what they gain adds up. It is the crossover
    of an evolutionary search, done once for every object.

    Args:
      plans: of which one is made [P, H, *shape].
      returns: of each [P].
      parts: what is taken from one plan or from another.
      evaluate: gives the returns [Q] of plans [Q, H, *shape], however many.

    Returns:
      The plan [H, *shape] and its return, which is no less than the best plan's.
    """
    order = np.argsort(-np.asarray(returns), kind="stable")
    best = {name: np.array(values[order[0]]) for name, values in plans.items()}
    reached = float(returns[order[0]])
    others = order[1 : 1 + _MOST_TRIALS // max(1, len(parts))]
    if len(parts) < 2 or not len(others):
        return best, reached
    trials = [_with(best, plans, [(part, other)]) for part in parts for other in others]
    alone = np.reshape(evaluate(_stacked(trials)), (len(parts), len(others)))
    gaining = np.flatnonzero(alone.max(axis=1) > reached).tolist()
    if not gaining:
        return best, reached
    taken = [(parts[place], others[int(alone[place].argmax())]) for place in gaining]
    together, single = _with(best, plans, taken), int(alone.argmax())
    of_all, of_one = float(evaluate(_stacked([together]))[0]), float(alone.flat[single])
    return (together, of_all) if of_all >= of_one else (trials[single], of_one)


def _with(
    plan: Mapping[str, np.ndarray], plans: Plans, taken: Sequence[tuple[Part, Any]]
) -> dict[str, np.ndarray]:
    """A plan with parts of others."""
    found = {name: values.copy() for name, values in plan.items()}
    for part, other in taken:
        for name, place in part:
            if place is None:
                found[name][:] = plans[name][other]
            else:
                found[name][:, place] = plans[name][other][:, place]
    return found


def _stacked(plans: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.stack([plan[name] for plan in plans]) for name in plans[0]}
