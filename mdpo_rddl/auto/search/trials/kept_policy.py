"""A policy on what trials have seen, as the places where its actions change from step to step."""

import numpy as np

from mdpo_rddl.auto.common.state import State
from mdpo_rddl.auto.search.trials.backward import Greedy
from mdpo_rddl.auto.search.trials.compact import read_numbers, small
from mdpo_rddl.auto.search.trials.explored import Explored


def policy_state(greedy: Greedy, explored: Explored) -> State:
    """The policy, with C changes and N states.

    Args:
      greedy: the policy.
      explored: to which it belongs, and which may have grown since.
    """
    known = greedy.rows.shape[1]
    # 0 where there is nothing to play
    choices = np.where(greedy.rows >= 0, greedy.rows - explored.first_row.values[:known] + 1, 0)
    later = np.zeros(known, np.int64)
    changed: list[np.ndarray] = []
    for now in reversed(choices):
        changed.append(np.flatnonzero(now != later))
        later = now
    chosen = [now[where] for now, where in zip(reversed(choices), changed, strict=True)]
    return State(
        {
            "counts": small(np.array([len(each) for each in changed], np.int64)),
            "states": small(np.concatenate(changed)),
            "choices": small(np.concatenate(chosen)),
            "popularity": greedy.popularity,
        },
        {"known": known, "value": greedy.value},
    )


def read_policy(state: State, explored: Explored) -> Greedy:
    """The policy that `policy_state` was given.

    Raises:
      KeyError, OverflowError, TypeError, ValueError: if it is none on what was seen.
    """
    model, value, known = explored.model, float(state.values["value"]), state.values["known"]
    if not (isinstance(known, int) and 0 < known <= explored.size and np.isfinite(value)):
        raise ValueError(f"its policy knows {known!r:.40} states, and is worth {value}")
    counts = read_numbers(state, "counts", model.horizon, known)
    states = read_numbers(state, "states", int(counts.sum()), known - 1)
    choices = read_numbers(state, "choices", len(states), np.iinfo(np.int32).max)
    first, most = explored.first_row.values[:known], explored.row_count.values[:known]
    if np.any(choices > most[states]):
        raise ValueError("its policy plays what cannot be played")
    ends, now = np.cumsum(counts), np.zeros(known, np.int64)
    rows = np.empty((model.horizon, known), np.int32)
    for place, step in enumerate(reversed(range(model.horizon))):
        own = slice(ends[place] - counts[place], ends[place])
        now[states[own]] = choices[own]
        if np.any((now == 0) != (most == 0)):
            raise ValueError("its policy plays nothing in some states")
        rows[step] = np.where(now > 0, first + now - 1, -1)
    popularity = state.array("popularity", (len(model.actions),)).astype(float)
    if np.any(popularity < 0.0):
        raise ValueError("its actions are less than never played")
    return Greedy(rows, value, popularity)
