"""Whole episodes of a policy on the simulator, many side by side."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.simulator.simulator import Simulator, State

Policy = Callable[[int, Mapping[str, np.ndarray]], Mapping[str, Any]]
"""(step, observation per fluent [*shape, b]) -> per action fluent [*shape, b], or what broadcasts
to that; the no-op where a fluent is missing."""


class Trajectories(NamedTuple):
    """What happened in B episodes, the longest of which has T steps.

    Once an episode is over its state stays, and its rewards are 0.

    Attributes:
      states: per fluent that is no action [T + 1, *shape, B], the first one where it began.
      actions: per action fluent [T, *shape, B].
      rewards: [T, B], not discounted.
    """

    states: Mapping[str, np.ndarray]
    actions: Mapping[str, np.ndarray]
    rewards: np.ndarray


class Rollouts(NamedTuple):
    """What B episodes came to.

    Attributes:
      returns: discounted sums of rewards [B].
      lengths: steps until a termination condition, a broken invariant, an error or the horizon
        [B]; a step that raised an error is not counted.
      errors: whether pyRDDLGym's environment would have raised an error [B].
      illegal: steps whose action broke a precondition or max-nondef-actions [B]; it was played as
        it was given, as pyRDDLGym's environment plays it that enforces nothing.
      trajectories: what happened at each step, where that was asked for.
    """

    returns: np.ndarray
    lengths: np.ndarray
    errors: np.ndarray
    illegal: np.ndarray
    trajectories: Trajectories | None


def rollout(
    simulator: Simulator,
    policy: Policy,
    episodes: int | State,
    seed: int,
    horizon: int | None = None,
    keep: bool = False,
) -> Rollouts:
    """Plays episodes of a policy, as pyRDDLGym's environment would.

    Blocks of `simulator.block` episodes are played one after the other, each from its first step
    to its last, so that a policy that remembers something begins anew at step 0. An episode that
    begins in a terminal state has no step.

    Args:
      simulator: of the problem.
      policy: decides for b episodes at once.
      episodes: how many, from the initial state; or a state [*shape, B], in which B episodes begin.
      seed: of all draws; the same one gives the same episodes.
      horizon: the most steps of an episode; the problem's if None.
      keep: whether to return states, actions and rewards by step, which takes memory for all of
        them; else that of one block.

    Raises:
      InputError: if the policy returns a fluent that is no action.
    """
    given = None if isinstance(episodes, int) else episodes
    count = episodes if isinstance(episodes, int) else next(iter(episodes.values())).shape[-1]
    steps = simulator.problem.horizon if horizon is None else horizon
    parts = []
    for number, first in enumerate(range(0, count, simulator.block)):
        last = min(first + simulator.block, count)
        state = (
            simulator.initial(last - first)
            if given is None
            else {name: value[..., first:last] for name, value in given.items()}
        )
        generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        parts.append(_block(simulator, policy, state, generator, (steps, keep)))
    if not parts:
        parts.append(_block(simulator, policy, simulator.initial(0), None, (0, keep)))
    returns, lengths, errors, illegal, kept = zip(*parts, strict=True)
    join = np.concatenate
    figures = join(returns), join(lengths), join(errors), join(illegal)
    return Rollouts(*figures, _joined(kept) if keep else None)


def _block(
    simulator: Simulator, policy: Policy, state: State, generator: Any, terms: tuple[int, bool]
) -> Rollouts:
    """All episodes of a block; `terms` are the horizon and whether steps are kept."""
    horizon, keep = terms
    alive = ~simulator.ended(state)
    replicas = len(alive)
    returns, factor = np.zeros(replicas), 1.0
    lengths, illegal = np.zeros(replicas, np.int64), np.zeros(replicas, np.int64)
    errors = np.zeros(replicas, bool)
    states, taken, rewards = [state], [], []
    for step in range(horizon):
        if not alive.any():
            break
        actions = policy(step, simulator.observation(state))
        check_names(simulator, actions)
        illegal += alive & ~simulator.legal(state, actions)
        outcome = simulator.step(state, actions, generator)
        played = alive & ~outcome.errors
        errors |= alive & outcome.errors
        reward = np.where(played, outcome.rewards, 0.0)
        returns += factor * reward
        factor *= simulator.problem.model.discount
        lengths += played
        state = chosen(played, outcome.state, state)
        alive = played & ~outcome.terminated & ~outcome.broken
        if keep:
            states.append(state)
            taken.append(_full(simulator, actions, replicas))
            rewards.append(reward)
    trajectories = None
    if keep:
        trajectories = Trajectories(
            {name: np.stack([each[name] for each in states]) for name in state},
            {
                name: np.array([each[name] for each in taken]).reshape(-1, *shape, replicas)
                for name, shape in ((name, simulator.shapes[name]) for name in simulator.actions)
            },
            np.array(rewards).reshape(-1, replicas),
        )
    return Rollouts(returns, lengths, errors, illegal, trajectories)


def chosen(mask: np.ndarray, state: State, other: State) -> State:
    """The state of the replicas in a mask [B], another state of those outside of it."""
    if mask.all():
        return state
    return {name: np.where(mask, value, other[name]) for name, value in state.items()}


def check_names(simulator: Simulator, actions: Mapping[str, Any]) -> None:
    """Raises `InputError` for actions that are not the problem's."""
    for name in actions.keys() - simulator.noop.keys():
        known = ", ".join(simulator.actions)
        raise InputError(f"there is no action fluent {name!r}, the problem has: {known}")


def _full(simulator: Simulator, actions: Mapping[str, Any], replicas: int) -> dict[str, np.ndarray]:
    """All action fluents [*shape, B] in their types."""
    return {
        name: np.broadcast_to(
            np.asarray(actions.get(name, noop[..., None])), (*noop.shape, replicas)
        ).astype(noop.dtype)
        for name, noop in simulator.noop.items()
    }


def _joined(parts: tuple[Trajectories, ...]) -> Trajectories:
    """The blocks side by side, the shorter ones continued: their states stay, nothing is paid."""
    longest = max(len(part.rewards) for part in parts)

    def side_by_side(arrays: list[np.ndarray], steps: int, mode: Any) -> np.ndarray:
        padded = [
            np.pad(each, [(0, steps - len(each)), *[(0, 0)] * (each.ndim - 1)], mode=mode)
            for each in arrays
        ]
        return np.concatenate(padded, axis=-1)

    return Trajectories(
        {
            name: side_by_side([part.states[name] for part in parts], longest + 1, "edge")
            for name in parts[0].states
        },
        {
            name: side_by_side([part.actions[name] for part in parts], longest, "constant")
            for name in parts[0].actions
        },
        side_by_side([part.rewards for part in parts], longest, "constant"),
    )
