"""Legal actions drawn at random."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.legal_moves import LegalMoves
from mdpo_rddl.problem.legality import action_box
from mdpo_rddl.problem.limits import GroupLimit, group_limits
from mdpo_rddl.problem.load import Problem

# how far a draw goes from the bound of a box that has but one
_WIDTH = 10.0
_DRAWS = 20


class RandomActions:
    """Draws each action anew at every step.

    Reals and integers are uniform in their box, of width 10 where it has but one bound; where it
    has none, they are normal around the default with standard deviation 1, as Gymnasium has it.
    Bools are fair coins, enums are uniform. Of a group of bools of which at most k may be true, one
    is true with probability 0.5; if exactly k must be, k are. No more fluents than
    `max-nondef-actions` leave their default. What is still illegal is drawn again, a few times.
    """

    def __init__(self, problem: Problem) -> None:
        """Reads the boxes and the limits on groups."""
        self._moves = LegalMoves(problem)
        env = self._moves.env
        self._model, self._defaults = env.model, dict(env.sampler.noop_actions)
        self._box = action_box(env)
        self._limits, _ = group_limits(env.model)

    def draw(self, state: Mapping[str, Any], rng: np.random.Generator) -> Mapping[str, Any]:
        """A legal draw; after too many that are not, a legal action near the last.

        Args:
          state: per fluent its value [*shape], in which the action must be legal.
          rng: draws.
        """
        for _ in range(_DRAWS):
            verdict = self._moves.rule(self._draw(rng), state)
            if not verdict.illegal:
                break
        return verdict.actions

    def _draw_number(self, name: str, rng: np.random.Generator, half: float) -> np.ndarray:
        """Real numbers, which reach `half` beyond what bounds them."""
        default, (lower, upper) = np.asarray(self._defaults[name], float), self._box[name]
        if half:
            # of "above 0" pyRDDLGym makes 1e-5
            lower, upper = np.ceil(lower), np.floor(upper)
        lower, upper, default = np.broadcast_arrays(lower, upper, default)
        is_low, is_high = np.isfinite(lower), np.isfinite(upper)
        low = np.where(is_low, lower, np.where(is_high, upper - _WIDTH, 0.0))
        high = np.where(is_high, upper, low + _WIDTH)
        within, around = rng.uniform(low - half, high + half), rng.normal(default)
        return np.asarray(np.where(is_low | is_high, within, around))

    def _draw(self, rng: np.random.Generator) -> dict[str, Any]:
        actions = {name: self._draw_fluent(name, rng) for name in self._defaults}
        for limit in self._limits:
            _draw_groups(limit, actions, rng)
        return self._within_count(actions, rng)

    def _draw_fluent(self, name: str, rng: np.random.Generator) -> Any:
        kind, shape = self._model.action_ranges[name], np.shape(self._defaults[name])
        if kind == "bool":
            return rng.random(shape) < 0.5
        if kind == "real":
            return self._draw_number(name, rng, half=0.0)
        if kind == "int":
            return np.rint(self._draw_number(name, rng, half=0.5)).astype(int)
        return rng.integers(len(self._model.type_to_objects[kind]), size=shape or None)

    def _within_count(self, actions: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
        arrays = {name: np.array(value) for name, value in actions.items()}
        changed = [
            (name, place)
            for name, value in arrays.items()
            for place in map(tuple, np.argwhere(value != self._defaults[name]))
        ]
        excess = len(changed) - self._model.max_allowed_actions
        if excess > 0:
            for index in rng.choice(len(changed), int(excess), replace=False):
                name, place = changed[index]
                arrays[name][place] = np.asarray(self._defaults[name])[place]
        return arrays


def _draw_groups(limit: GroupLimit, actions: dict[str, Any], rng: np.random.Generator) -> None:
    """Replaces the bools of each group by a legal draw."""
    names = list(limit.groups)
    group = np.concatenate([np.ravel(limit.groups[name]) for name in names])
    values = np.concatenate([np.ravel(actions[name]) for name in names])
    values[group >= 0] = False
    for number, most in enumerate(limit.limits):
        wanted = int(most) if limit.exact else min(int(most), int(rng.random() < 0.5))
        members = np.flatnonzero(group == number)
        values[rng.choice(members, min(wanted, len(members)), replace=False)] = True
    start = 0
    for name in names:
        shape = np.shape(actions[name])
        size = int(np.prod(shape))
        actions[name] = values[start : start + size].reshape(shape)
        start += size
