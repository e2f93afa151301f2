"""What constant actions say about a problem: its units and scales, and which constant is good."""

import contextlib
import logging
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.planner.plans.lookups import Lookups, lookups
from mdpo_rddl.problem.boxes import action_boxes
from mdpo_rddl.problem.chance import has_draws
from mdpo_rddl.problem.evaluation import LOST
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.race.budget import DeadlineError
from mdpo_rddl.race.evaluator import Check, episodes_of, worth_of
from mdpo_rddl.simulator.simulator import Simulator

logger = logging.getLogger(__name__)

_CONSTANTS, _EPISODES = 32, 4
# episodes in which chance must not show
_CONFIRMING = 128
# constant actions without a box are tried in these sizes; a smaller answer is rounding
_SIZES = 10.0 ** np.arange(-3.0, 6.01, 0.5)
# beside others that are changed by such shares of their boxes
_SHARES = (0.0, 0.5, 1.0)
_ANSWER = 1e-6
# a size is harmful that loses so much of the no-op's return
_LOSS = 0.1
# replicas and steps whose states are looked at
_SEEN = 64
# a spread is at most so many times that of the first tenth of the steps: a state that runs away
# would have a scale in which nothing else is seen
_RUNAWAY = 30.0
# of what is looked up, and how much two numbers may differ to be the same in other units
_MOST_LOOKUPS, _SAME = 16, 0.999


class Probe(NamedTuple):
    """What constant actions have shown.

    Attributes:
      units: per action fluent without a box, the size at which the return answers.
      state_scales: per observed fluent its centre and spread over what was seen.
      lookup_scales: the same of what is read at objects that the state names.
      constants: that were played, per action fluent [*shape, P], the no-op first.
      means: of their returns [P].
      is_certain: whether chance plays no part.
      raises: whether the environment raised an error in some episode.
    """

    units: Mapping[str, float]
    state_scales: Mapping[str, tuple[float, float]]
    lookup_scales: Mapping[str, tuple[float, float]]
    constants: Mapping[str, np.ndarray]
    means: np.ndarray
    is_certain: bool
    raises: bool = False


def _no_check() -> None:
    """There is time for all."""


def probe(problem: Problem, simulator: Simulator, seed: int, check: Check = _no_check) -> Probe:
    """Plays constant actions.

    Args:
      problem: the problem.
      simulator: of it.
      seed: of the actions and the episodes.
      check: called at each step; where it raises `DeadlineError`, what was seen by then counts.
    """
    random = np.random.default_rng(seed)
    bounds = action_boxes(problem.model)
    play = _Constants(simulator, check)
    units = _units(problem, play, bounds, seed)
    drawn = [_drawn(problem, simulator, bounds, units, random) for _ in range(_CONSTANTS - 1)]
    noop = dict(simulator.noop)
    constants = {
        name: np.stack([value, *(each[name] for each in drawn)], axis=-1)
        for name, value in noop.items()
    }
    play.seen.clear()
    returns = play(constants, _EPISODES, seed)
    seen = list(play.seen)
    certain = not has_draws(problem.model) or _is_certain(play, constants, returns, seed)
    scales = _state_scales(problem, seen)
    lookup = _lookup_scales(problem, simulator, seen, scales)
    means = returns.mean(axis=1)
    return Probe(units, scales, lookup, constants, means, certain, play.raises)


class _Constants:
    """Plays constant actions until it is late.

    Attributes:
      seen: some of the states on the way, per fluent [*shape, b].
      raises: whether the environment would have raised an error in some episode.
    """

    def __init__(self, simulator: Simulator, check: Check) -> None:
        self.simulator, self._check = simulator, check
        self.seen: list[dict[str, np.ndarray]] = []
        self.raises = False

    def __call__(self, constants: Mapping[str, np.ndarray], episodes: int, seed: Any) -> np.ndarray:
        """The worth of episodes [P, N]; minus infinity of those that there was no time for.

        Args:
          constants: per action fluent [*shape, P].
          episodes: of each constant, N.
          seed: of the episodes.
        """
        count = next(iter(constants.values())).shape[-1]
        at_once = max(1, self.simulator.block // episodes)
        found = np.full((count, episodes), -np.inf)
        with contextlib.suppress(DeadlineError):
            for first in range(0, count, at_once):
                some = {
                    name: np.repeat(value[..., first : first + at_once], episodes, axis=-1)
                    for name, value in constants.items()
                }
                size = next(iter(some.values())).shape[-1]
                played = episodes_of(
                    self.simulator, partial(self._play, some), size, seed, size // episodes
                )
                self.raises |= bool(played.errors.any())
                worth = worth_of(played, self.simulator.problem.horizon)
                found[first : first + at_once] = worth.reshape(-1, episodes)
        return found

    def _play(self, some: Mapping[str, np.ndarray], step: int, observation: Any) -> Any:
        self._check()
        # of one constant fewer may be played at once than episodes were asked for
        count = next(iter(observation.values())).shape[-1]
        places = np.linspace(0, count - 1, min(count, _SEEN)).astype(int)
        self.seen.append({name: value[..., places] for name, value in observation.items()})
        return {name: value[..., :count] for name, value in some.items()}


def _is_certain(
    play: _Constants, constants: Mapping[str, np.ndarray], returns: np.ndarray, seed: int
) -> bool:
    """Whether constants of several returns have the same in every episode, also in many more."""
    means = returns.mean(axis=1)
    if np.any(returns != returns[:, :1]) or len(np.unique(means[means > LOST])) < 2:
        return False
    best = {name: value[..., [int(np.argmax(means))]] for name, value in constants.items()}
    return bool(np.ptp(play(best, _CONFIRMING, seed + 1)) == 0.0)


def _units(
    problem: Problem, play: _Constants, bounds: Mapping[str, Any], seed: int
) -> dict[str, float]:
    """The size at which the return answers to each number without a box.

    It is scanned beside constants of the other actions: the no-op, and all of them changed by half
    of their boxes or by all of it. Where some constant beats those without it, it is the size of
    the best; else the largest that does little harm, and 1 where nothing answers.
    """
    ranges, found = problem.model.variable_ranges, dict[str, float]()
    simulator = play.simulator
    sizes = np.concatenate([[0.0], _SIZES, -_SIZES])
    for name, (lower, upper) in bounds.items():
        if ranges[name] not in ("real", "int") or np.any(np.isfinite(upper - lower)):
            continue
        rows = []
        for share in _SHARES:
            scan = {
                each: np.repeat(value[..., np.newaxis], len(sizes), axis=-1)
                for each, value in _changed(simulator, bounds, share).items()
            }
            ends = lower[..., np.newaxis], upper[..., np.newaxis]
            moved = simulator.noop[name][..., np.newaxis] + sizes
            scan[name] = np.clip(moved, *ends).astype(scan[name].dtype)
            rows.append(play(scan, 1, seed)[:, 0])
        returns = np.stack(rows)
        none = np.maximum(returns[:, :1], LOST)
        margin = np.where(none > LOST, np.abs(none), 0.0)
        answers = np.abs(returns - none) > _ANSWER * margin
        harmless = np.any(answers & (returns >= none - _LOSS * margin), axis=0)
        gains = np.max(np.where(answers, returns - none, 0.0), axis=0)
        best = int(np.argmax(gains))
        unit = np.abs(sizes[best] if gains[best] > 0.0 else sizes[harmless])
        found[name] = float(np.max(unit, initial=0.0)) or 1.0
        logger.info("unit of %s: %g", name, found[name])
    return found


def _changed(
    simulator: Simulator, bounds: Mapping[str, Any], share: float
) -> dict[str, np.ndarray]:
    """The no-op with all actions changed by a share of their boxes, or of 1; bools are flipped."""
    if not share:
        return dict(simulator.noop)
    found = {}
    for name, noop in simulator.noop.items():
        if noop.dtype == bool:
            found[name] = ~noop
            continue
        lower, upper = bounds[name]
        top = np.where(np.isfinite(upper), upper, np.maximum(noop, lower) + 1.0)
        found[name] = (noop + share * (top - noop)).astype(noop.dtype)
    return found


def _drawn(
    problem: Problem,
    simulator: Simulator,
    bounds: Mapping[str, Any],
    units: Mapping[str, float],
    random: np.random.Generator,
) -> dict[str, np.ndarray]:
    """A constant: each fluent at its no-op, at one place for all objects, or at one for each."""
    model, drawn = problem.model, {}
    for name, noop in simulator.noop.items():
        kind, place = model.variable_ranges[name], np.asarray(random.random(noop.shape))
        if random.random() < 0.5:
            place = np.full(noop.shape, random.random())
        if random.random() < 0.25:
            drawn[name] = noop
        elif kind == "bool":
            drawn[name] = (place < random.random()) ^ noop.astype(bool)
        elif kind in ("real", "int"):
            lower, upper = bounds[name]
            unit = units.get(name, 1.0)
            low = np.where(np.isfinite(lower), lower, np.minimum(noop, upper) - unit)
            high = np.where(np.isfinite(upper), upper, np.maximum(noop, lower) + unit)
            value = low + (high - low) * place
            drawn[name] = (np.round(value) if kind == "int" else value).astype(noop.dtype)
        else:
            count = len(model.type_to_objects[kind])
            drawn[name] = np.floor(place * count).astype(noop.dtype)
    return drawn


def _state_scales(
    problem: Problem, seen: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, tuple[float, float]]:
    """Centre and spread of all values of each observed fluent, neither moved by a few extremes."""
    scales = {}
    for name in seen[0]:
        if problem.model.variable_ranges[name] == "bool":
            scales[name] = 0.5, 0.5
            continue
        early = _middle(seen[: max(1, len(seen) // 10)], name)
        center, spread = _middle(seen, name)
        if 0.0 < early[1] * _RUNAWAY < spread:
            center, spread = early[0], early[1] * _RUNAWAY
        scales[name] = center, spread if spread > 1e-6 * max(1.0, abs(center)) else 1.0
    return scales


def _middle(seen: Sequence[Mapping[str, np.ndarray]], name: str) -> tuple[float, float]:
    """Median, and the deviation of a normal law that reaches as far from 10 to 90%."""
    values = np.concatenate([np.ravel(each[name]) for each in seen]).astype(float)
    values = values[np.isfinite(values)]
    if not values.size:
        return 0.0, 1.0
    low, median, high = np.percentile(values, [10, 50, 90])
    spread = (high - low) / 2.56
    return float(median), float(spread or min(np.std(values), 1e3))


def _lookup_scales(
    problem: Problem,
    simulator: Simulator,
    seen: Sequence[Mapping[str, np.ndarray]],
    scales: Mapping[str, tuple[float, float]],
) -> dict[str, tuple[float, float]]:
    """Of what is looked up and says what no fluent says already, in other units."""
    chosen, found = lookups(problem.model), dict[str, tuple[float, float]]()
    if not chosen:
        return found
    some = seen[:: max(1, len(seen) // _SEEN)]
    states = {name: np.concatenate([each[name] for each in some], axis=-1) for name in seen[0]}
    count = next(iter(states.values())).shape[-1]
    look = Lookups(problem.model, simulator.values, list(chosen))(states, (count,))
    known = [value.astype(float) for value in states.values()]
    for name, lookup in chosen.items():
        value = look[name].astype(float)
        if len(found) == _MOST_LOOKUPS or not np.any(np.std(value, axis=-1) > 0.0):
            continue
        if any(_is_same(value, other) for other in known):
            continue
        known.append(value)
        usual = float(np.mean(value)), float(np.std(value))
        is_bool = problem.model.variable_ranges[lookup.fluent] == "bool"
        found[name] = (0.5, 0.5) if is_bool else scales.get(lookup.fluent, usual)
    return found


def _is_same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether one [*shape, B] changes as the other does."""
    if one.shape != other.shape:
        return False
    changes = np.stack(
        [np.ravel(each - each.mean(axis=-1, keepdims=True)) for each in (one, other)]
    )
    if not all(map(np.any, changes)):
        return False
    return bool(abs(np.corrcoef(changes)[0, 1]) > _SAME)
