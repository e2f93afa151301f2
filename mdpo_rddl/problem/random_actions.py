"""Legal actions drawn at random."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.legal_moves import LegalMoves
from mdpo_rddl.problem.legality import action_box
from mdpo_rddl.problem.limits import GroupLimit, group_limits
from mdpo_rddl.problem.load import Problem

DRAWS = 20
"""After so many that are not legal the last one is replaced."""

# how far a draw goes from the bound of a box that has but one
_WIDTH = 10.0


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
        for _ in range(DRAWS):
            drawn = {name: value[..., 0] for name, value in self.draws(1, rng).items()}
            verdict = self._moves.rule(drawn, state)
            if not verdict.illegal:
                break
        return verdict.actions

    def draws(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Draws that need not be legal, per action fluent [*shape, count].

        Args:
          count: how many.
          rng: draws.
        """
        actions = {name: self._draw_fluent(name, count, rng) for name in self._defaults}
        for limit in self._limits:
            _draw_groups(limit, actions, rng)
        return self._within_count(actions, rng)

    def _draw_fluent(self, name: str, count: int, rng: np.random.Generator) -> np.ndarray:
        kind, shape = self._model.action_ranges[name], (*np.shape(self._defaults[name]), count)
        if kind == "bool":
            return rng.random(shape) < 0.5
        if kind == "real":
            return self._draw_number(name, shape, rng, half=0.0)
        if kind == "int":
            return np.rint(self._draw_number(name, shape, rng, half=0.5)).astype(int)
        return rng.integers(len(self._model.type_to_objects[kind]), size=shape)

    def _draw_number(
        self, name: str, shape: tuple[int, ...], rng: np.random.Generator, half: float
    ) -> np.ndarray:
        """Real numbers, which reach `half` beyond what bounds them."""
        default, (lower, upper) = np.asarray(self._defaults[name], float), self._box[name]
        if half:
            # of "above 0" pyRDDLGym makes 1e-5
            lower, upper = np.ceil(lower), np.floor(upper)
        lower, upper, default = (
            each[..., np.newaxis] for each in np.broadcast_arrays(lower, upper, default)
        )
        is_low, is_high = np.isfinite(lower), np.isfinite(upper)
        low = np.where(is_low, lower, np.where(is_high, upper - _WIDTH, 0.0))
        high = np.where(is_high, upper, low + _WIDTH)
        within = rng.uniform(low - half, high + half, shape)
        return np.where(is_low | is_high, within, rng.normal(default, size=shape))

    def _within_count(
        self, actions: dict[str, np.ndarray], rng: np.random.Generator
    ) -> dict[str, np.ndarray]:
        """Puts back to their defaults as many fluents as are too many."""
        most = self._model.max_allowed_actions
        if not actions:
            return actions
        defaults = {name: np.asarray(v)[..., np.newaxis] for name, v in self._defaults.items()}
        changed = {name: value != defaults[name] for name, value in actions.items()}
        flat = np.concatenate([each.reshape(-1, each.shape[-1]) for each in changed.values()])
        if not np.any(flat.sum(axis=0) > most):
            return actions
        stays = _some(flat, np.full(flat.shape[-1], most), rng)
        kept = _split(stays, list(changed.values()))
        return {
            name: np.where(kept[place], actions[name], defaults[name])
            for place, name in enumerate(actions)
        }


def _draw_groups(
    limit: GroupLimit, actions: dict[str, np.ndarray], rng: np.random.Generator
) -> None:
    """Replaces the bools of each group by a legal draw."""
    names = list(limit.groups)
    group = np.concatenate([np.ravel(limit.groups[name]) for name in names])
    values = np.concatenate([actions[name].reshape(-1, actions[name].shape[-1]) for name in names])
    count = values.shape[-1]
    for number, most in enumerate(limit.limits):
        wanted = np.full(count, int(most))
        if not limit.exact:
            wanted = np.minimum(wanted, rng.random(count) < 0.5)
        members = group == number
        values[members] = _some(np.ones((int(members.sum()), count), bool), wanted, rng)
    for name, part in zip(names, _split(values, [actions[n] for n in names]), strict=True):
        actions[name] = part


def _some(of: np.ndarray, most: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Of the true values [N, B] of each column at most so many [B], all as likely."""
    keys = np.where(of, rng.random(of.shape), np.inf)
    places = np.argsort(np.argsort(keys, axis=0), axis=0)
    return of & (places < most)


def _split(rows: np.ndarray, like: list[np.ndarray]) -> list[np.ndarray]:
    """Rows [N, B] as arrays of these shapes [*shape, B]."""
    ends = np.cumsum([each.size // each.shape[-1] for each in like])[:-1]
    return [part.reshape(each.shape) for part, each in zip(np.split(rows, ends), like, strict=True)]
