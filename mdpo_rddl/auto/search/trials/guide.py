"""What leads trials to where a reward is hard to reach: hope, and a guess of what was not tried.

As `backward`, with two changes. After an action trials look forward to a mixture of the mean and
of the best that has followed it:

    Q_t(s, a) = r(s, a) + g ((1 - h) sum_k P(k) V_{t+1}(k) + h max_k V_{t+1}(k))

And an action that was not tried in a state is worth what a linear function of the state's
variables and the step says, fitted (by ridge regression) to such values, with more hope, of the
states in which some action was. It plays the part of the heuristic in the search of AND-OR graphs
(LAO*, Hansen and Zilberstein 2001), but is learnt from what was seen, and not admissible.
"""

from collections.abc import Callable, Iterator

import numpy as np

from mdpo_rddl.auto.search.trials.backward import Future, Greedy, Guess, greedy_of, induct, swept
from mdpo_rddl.auto.search.trials.explored import Explored

# of the values that are fitted, and of those that are followed
_FITTED_HOPE, _HOPE = 0.8, 0.3
# states that are fitted to, their variables' values, and the ridge as a share of the states
_MOST_FITTED, _MOST_VALUES, _RIDGE = 10_000, 5_000_000, 1e-4
# from one look at the clock to the next
_VARIABLES_UNTIMED = 64


def guide(explored: Explored, check_time: Callable[[], None] = lambda: None) -> Greedy:
    """The policy to follow.

    Args:
      explored: what was seen.
      check_time: as of `induct`.
    """
    seen = _seen(explored)
    if not seen.any():
        return induct(explored, 1.0, check_time)
    hopeful = Future(explored, 1.0, _FITTED_HOPE)
    at_depth = swept(explored, hopeful, check_time)[1]
    guess = _fitted(explored, np.flatnonzero(seen), at_depth, check_time)
    future = Future(explored, 1.0, _HOPE)
    return greedy_of(explored, *swept(explored, future, check_time, guess))


def _seen(explored: Explored) -> np.ndarray:
    """Whether something is known to follow a state [S], and it was reached from the initial one."""
    seen = np.zeros(explored.size, bool)
    seen[explored.owners()[explored.was_drawn()[explored.afterstate.values]]] = True
    return seen & (explored.depth.values < explored.model.horizon)


def _fitted(
    explored: Explored,
    states: np.ndarray,
    at_depth: np.ndarray,
    check_time: Callable[[], None] = lambda: None,
) -> Guess:
    """A linear function of a state and a step, no larger and no smaller than what it is fitted to.

    Args:
      explored: with S states.
      states: numbers of those to fit it to.
      at_depth: of each state the value at the least step at which it is reached [S].
      check_time: as of `induct`.
    """
    most = max(1, min(_MOST_FITTED, _MOST_VALUES // (1 + len(explored.model.variables))))
    states = states[:: 1 + len(states) // most]
    horizon, own = explored.model.horizon, explored.index.states
    known, steps = at_depth[states], explored.depth.values[states] / explored.model.horizon
    inputs = [*_variables(explored, own[states]), steps]
    centres = np.array([np.mean(each) for each in inputs])
    matrix = np.stack(inputs) - centres[:, np.newaxis]
    ridge = _RIDGE * len(states) * np.eye(len(inputs))
    weights = np.linalg.solve(matrix @ matrix.T + ridge, matrix @ (known - np.mean(known)))
    base = np.full(explored.size, np.mean(known) - weights @ centres)
    for number, values in enumerate(_variables(explored, own)):
        base += weights[number] * values
        if (number + 1) % _VARIABLES_UNTIMED == 0:
            check_time()
    low, high = np.min(known), np.max(known)
    return lambda step: np.clip(base + weights[-1] * step / horizon, low, high)


def _variables(explored: Explored, states: np.ndarray) -> Iterator[np.ndarray]:
    """The values [N] of one variable after another in states [N, words]."""
    packing = explored.model.packing
    for number in range(len(explored.model.variables)):
        yield packing.decode(number, states).astype(float)
