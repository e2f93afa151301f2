"""What a table returns: fresh episodes on the ground model, many side by side."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mdpo_rddl.auto.search.tables import Run
from mdpo_rddl.auto.search.trials.backward import Greedy
from mdpo_rddl.auto.search.trials.explored import Explored
from mdpo_rddl.problem.enumeration.irrelevance import merged


class Play(NamedTuple):
    """Episodes of a policy.

    Attributes:
      returns: of each episode [N].
      missed: share of the decisions in states that the policy does not know.
    """

    returns: np.ndarray
    missed: float


# from one look at the clock to the next; of what a policy does not know, for which a row is made,
# which may take half a millisecond
_STEPS_UNTIMED, _MISSED_UNTIMED = 32, 256


def play(
    explored: Explored,
    greedy: Greedy,
    episodes: int,
    seed: int,
    fresh: bool = False,
    check_time: Callable[[], None] = lambda: None,
) -> Play:
    """Plays a policy; where it knows nothing, the default action or else one that is legal.

    Args:
      explored: to which the policy belongs; stays as it is.
      greedy: the policy.
      episodes: number of them, N.
      seed: of all draws, which the search does not use.
      fresh: whether to draw others, for a policy that was chosen by those.
      check_time: called now and then; what it raises ends the episodes.

    Raises:
      NotEnumerableError: if a state has no legal action, or a probability is none.
    """
    model, random = explored.model, np.random.default_rng([seed, 2 if fresh else 1])
    returns, running = np.zeros(episodes), np.arange(episodes)
    states = np.repeat(model.initial[np.newaxis], episodes, axis=0)
    missed, decisions, timed = 0, 0, 0
    for step in range(model.horizon):
        if (step + 1) % _STEPS_UNTIMED == 0 or missed - timed >= _MISSED_UNTIMED:
            timed = missed
            check_time()
        turn = _turn(explored, greedy, merged(states, explored.merges), step)
        running = running[turn.playing]
        if not len(running):
            break
        returns[running] += model.discount**step * turn.reward
        missed += turn.missed
        decisions += len(running)
        states, _ = explored.afterstates.sample(turn.afterstates, random)
    return Play(returns, missed / max(1, decisions))


class _Turn(NamedTuple):
    """One decision in each of N episodes, of which M go on."""

    playing: np.ndarray  # which episodes go on [M]
    reward: np.ndarray  # [M]
    afterstates: np.ndarray  # [M, words]
    missed: int  # how many states the policy does not know


def _turn(explored: Explored, greedy: Greedy, states: np.ndarray, step: int) -> _Turn:
    number = explored.index.known(states)
    number[number >= greedy.rows.shape[1]] = -1
    # a state that was seen after the last step only has no action in the table
    number[(number >= 0) & (explored.depth.values[number] >= len(greedy.rows))] = -1
    known, unknown = np.flatnonzero(number >= 0), np.flatnonzero(number < 0)
    known = known[explored.row_count.values[number[known]] > 0]
    if len(unknown):
        unknown = unknown[~explored.maker.ended(states[unknown])]
    # as a table plays a state that it knows of later steps only
    when = np.maximum(step, explored.depth.values[number[known]])
    rows = greedy.rows[np.minimum(when, len(greedy.rows) - 1), number[known]]
    reward = explored.reward.values[rows]
    afterstates = explored.after_index.states[explored.afterstate.values[rows]]
    if len(unknown):
        made = explored.maker.first(states[unknown])
        reward = np.concatenate([reward, made.reward])
        afterstates = np.concatenate([afterstates, made.afterstates])
    return _Turn(np.concatenate([known, unknown]), reward, afterstates, len(unknown))


def runs(explored: Explored, greedy: Greedy) -> list[Run]:
    """Where the actions of a policy change, the last step first."""
    depth = explored.depth.values[: greedy.rows.shape[1]]
    last = np.full(len(depth), -1)
    found = []
    for step in reversed(range(explored.model.horizon)):
        rows = greedy.rows[step]
        action = np.where(rows >= 0, explored.action.values[rows], -1)
        changed = np.flatnonzero((action != last) & (depth <= step))
        found.append((step, changed, action[changed]))
        last[changed] = action[changed]
    return found
