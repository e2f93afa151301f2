"""What the model itself says about the scale of its states and actions.

The exact model is played with constant actions. That costs a second, and says in which units
states and actions are of order 1, and which constant action is a good start.
"""

import dataclasses
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.auto.common.sizes import Batches, fitting_batches, is_large, judge_rollouts
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.probing.constants import Constant, Constants
from mdpo_rddl.auto.probing.lookup_scales import lookup_scales
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import box_width
from mdpo_rddl.planner.update.action_scales import SIZES, answering_size
from mdpo_rddl.problem.chance import has_draws

logger = logging.getLogger(__name__)

_STARTS, _FEW_STARTS = 32, 4
_ROLLOUTS = 4
# batches in which the best constant and the no-op are compared
_AGAIN = 4
# and in which chance must play no part
_CONFIRMING = 8
_WIDE_UNITS = 1.5
# of the time left: what one candidate's rollouts may take, and on large problems
_SLOW, _SLOW_ONE = 0.05, 0.01
# of the box of each other action
_HALF = 0.5
# a state runs away whose spread is so many times that of the first steps, a share of all; its
# spread then counts as so many times theirs
_EARLY, _RUNAWAY, _RAN = 0.1, 1e3, 30.0


@dataclass(frozen=True)
class Probe:
    """What constant actions show.

    Attributes:
      units: per action fluent without a box, the size at which the return answers.
      state_scales: per observed fluent its median and its spread over what was seen.
      noop_return: mean return of the no-op.
      start: the constant raw action of the largest return, per fluent [*shape].
      start_return: its mean return.
      deterministic: whether chance plays no part in the return: nothing is drawn, or constants
        of several returns had the same in each rollout, and what they change is not random.
      certain: whether the states were the same in each rollout, too.
      policy_seconds: that one policy takes where the problem is large; None elsewhere.
      compile_seconds: that a program for rollouts is likely to take, by what plays constants.
      batch_seconds: that 128 of their rollouts take; 0 if one batch was played only.
      lookup_scales: as `state_scales`, of what a policy reads at the objects that the state names.
    """

    units: dict[str, float]
    state_scales: dict[str, tuple[float, float]]
    noop_return: float
    start: dict[str, np.ndarray]
    start_return: float
    deterministic: bool
    certain: bool
    policy_seconds: float | None
    compile_seconds: float = 0.0
    batch_seconds: float = 0.0
    lookup_scales: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)

    def judge_rollouts(self, most: int, left: float) -> int:
        """Rollouts of each candidate that is judged.

        Args:
          most: number of them, a power of two.
          left: seconds of the race.
        """
        if self.policy_seconds is None:
            return judge_rollouts(most, self.batch_seconds / (_STARTS * _ROLLOUTS), _SLOW * left)
        # without chance few rollouts are as good
        limit = 0.0 if self.deterministic else _SLOW_ONE * left
        return judge_rollouts(most, self.policy_seconds, limit)


def constants_for(
    planner: MDPOPlanner,
    seed: int,
    until: float = math.inf,
    clock: Clock = time.monotonic,
    deadline: float = math.inf,
) -> Constants:
    """What plays the constants of a probing; nothing is compiled yet.

    Args:
      planner: with a `FeedbackPlan` without scales, whose units are 1 where there is no box.
      seed: of the model.
      until: when to end, by the clock, once two were played; compilation is not counted.
      clock: what is asked for the time.
      deadline: when to end at the latest, by the clock.
    """
    size = Batches(_FEW_STARTS, 1, 1)
    size = size if is_large(planner) else fitting_batches(planner, _STARTS, _ROLLOUTS)
    return Constants(planner, seed, size, until, clock, deadline)


def probe(plays: Constants, seed: int) -> Probe:
    """Plays constant actions on the exact model.

    Args:
      plays: what `constants_for` has made.
      seed: of the actions.

    Raises:
      TooLateError: if the deadline comes before any constant was played.
    """
    planner, size = plays.planner, plays.size
    large = is_large(planner)
    params = planner.feedback_plan.noop(seed)
    shapes = {name: np.shape(own["bias"]) for name, own in params["own"].items()}
    numbers = list(planner.feedback_plan.units)
    noop = {name: np.zeros(shape) for name, shape in shapes.items()}
    full = {name: np.ones(shape) for name, shape in shapes.items()}
    open_ended = [
        name for name in numbers if box_width(*planner.feedback_plan.bounds[name]) is None
    ]
    others = [noop] if large else [noop, full, {n: _HALF * v for n, v in full.items()}]
    units = {name: _unit(name, others, plays.means) for name in open_ended}
    random = np.random.default_rng(seed)
    places = boxes(planner, units)
    starts = [noop, full, *(_random_start(random, places) for _ in range(size.constants - 2))]
    scaled = [without_units(units, start) for start in starts]
    means, states = plays.means_and_states(scaled, at_least=2)
    if not (large or plays.batch_seconds):
        plays.means(scaled[: size.at_once])  # the first batch has compiled, the second tells a pace
    seconds = plays.seconds
    best = int(np.argmax(means))
    scales = {
        name: (0.5, 0.5) if planner.rddl.variable_ranges[name] == "bool" else _scale(values)
        for name, values in states.items()
    }
    draws = has_draws(planner.rddl)
    # where some constant does something, and what it does is the same each time
    answers = len(np.unique(means[np.isfinite(means)])) > 1
    shown = size.rollouts > 1 and answers and plays.is_without_chance
    if draws and shown:
        # a few rollouts may miss what is seldom drawn
        shown = plays.confirm(scaled, _CONFIRMING)
    found = Probe(
        units=units,
        state_scales=scales,
        noop_return=float(means[0]),
        start=starts[best],
        start_return=float(means[best]),
        deterministic=bool(not draws or shown),
        certain=bool(not draws or (shown and plays.saw_alike)),
        policy_seconds=seconds if large else None,
        compile_seconds=plays.usual_seconds,
        batch_seconds=plays.batch_seconds * _STARTS * _ROLLOUTS / (size.at_once * size.rollouts),
        lookup_scales={} if large else lookup_scales(planner, states, scales),
    )
    if found.deterministic or large:
        return found
    # the best of many was lucky, be it the no-op
    return _in_fresh_rollouts(found, plays.fresh_returns(scaled[0], scaled[best], _AGAIN))


def without_units(units: Mapping[str, float], constant: Constant) -> Constant:
    """A constant for the probing's planner, whose units are 1 where there is no box.

    Args:
      units: per action fluent without a box, as a `Probe` has them.
      constant: in these units.
    """
    return {name: units.get(name, 1.0) * values for name, values in constant.items()}


def _in_fresh_rollouts(probe: Probe, returns: np.ndarray) -> Probe:
    """The probe with what the no-op and the best constant return in other rollouts [2, R]."""
    if not np.isfinite(returns).all() or returns.shape[1] < 2:
        return probe
    noop, start = np.mean(returns, axis=1)
    return dataclasses.replace(probe, noop_return=float(noop), start_return=float(start))


def _unit(
    name: str,
    others: list[dict[str, np.ndarray]],
    returns: Callable[[list[dict[str, np.ndarray]]], np.ndarray],
) -> float:
    """The size at which the return answers to an action, beside constants of the others."""
    shape = others[0][name].shape
    scan = [{**other, name: np.full(shape, size)} for other in others for size in SIZES]
    unit = answering_size(SIZES, returns(scan).reshape(len(others), len(SIZES)))
    logger.info("unit of %s: %g", name, unit)
    return unit


def boxes(planner: MDPOPlanner, units: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Where to draw each raw action from: its box, or a unit to either side [2, *shape]."""
    values, ends_of = planner.compiled.init_values, {}
    for name in planner.rddl.action_fluents:
        shape = np.shape(values[name])
        box = np.stack([np.full(shape, -1.0), np.full(shape, 1.0)])
        if name in planner.feedback_plan.units:
            unit = units.get(name, planner.feedback_plan.units[name])
            bounds = planner.feedback_plan.bounds[name]
            ends = np.stack([np.broadcast_to(bound, shape) for bound in bounds]) - values[name]
            box = np.where(np.isfinite(ends), ends / unit, box * _WIDE_UNITS)
        ends_of[name] = box
    return ends_of


def _random_start(
    random: np.random.Generator, places: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Per fluent the no-op, one place in the box for all objects, or one for each."""
    start = {}
    for name, (lower, upper) in places.items():
        place = random.random(lower.shape) if random.random() < 0.5 else random.random()
        start[name] = (lower + (upper - lower) * place) * (random.random() < 0.75)
    return start


def _scale(batches: Sequence[np.ndarray]) -> tuple[float, float]:
    """Median and spread of all values of a fluent, neither moved by a few that run away.

    Where all of them do, as those of an unstable system, the spread is a few times that of the
    first steps.

    Args:
      batches: values [P, N, steps, *shape].
    """
    values = _finite(batches)
    if not values.size:
        return 0.0, 1.0
    median, spread = _middle(values)
    spread = spread or min(float(np.std(values, dtype=float)), 1e3)
    first = _finite([b[:, :, : max(1, round(_EARLY * b.shape[2]))] for b in batches])
    center, early = _middle(first) if first.size else (median, 0.0)
    if spread > _RUNAWAY * early > 0.0:
        median, spread = center, _RAN * early
    return median, spread if spread > 1e-6 * max(1.0, abs(median)) else 1.0


def _finite(batches: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([values[np.isfinite(values)] for values in batches])


def _middle(values: np.ndarray) -> tuple[float, float]:
    """Median, and the deviation of a normal law that reaches as far from 10 to 90%."""
    low, median, high = (float(q) for q in np.percentile(values, [10, 50, 90]))
    return median, (high - low) / 2.56
