"""What the model itself says about the scale of its states and actions.

The exact model is played with constant actions. That costs a second, and says in which units
states and actions are of order 1, and which constant action is a good start.
"""

import dataclasses
import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.sizes import is_large
from mdpo_rddl.auto.state import State
from mdpo_rddl.auto.timing import Clock
from mdpo_rddl.planner.exact import compile_visits
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.plans.feedback_plan import box_width
from mdpo_rddl.planner.update.action_scales import SIZES, answering_size

logger = logging.getLogger(__name__)

_STARTS, _FEW_STARTS = 32, 4
_ROLLOUTS = 4
_WIDE_UNITS = 1.5
# of the box of each other action
_HALF = 0.5


@dataclass(frozen=True)
class Probe:
    """What constant actions show.

    Attributes:
      units: per action fluent without a box, the size at which the return answers.
      state_scales: per observed fluent its median and its spread over what was seen.
      noop_return: mean return of the no-op.
      start: the constant raw action of the largest return, per fluent [*shape].
      start_return: its mean return.
      deterministic: whether all rollouts of each constant had the same return.
      certain: whether there were several, and they had the same states, too.
      policy_seconds: that one policy takes where the problem is large; None elsewhere.
    """

    units: dict[str, float]
    state_scales: dict[str, tuple[float, float]]
    noop_return: float
    start: dict[str, np.ndarray]
    start_return: float
    deterministic: bool
    certain: bool
    policy_seconds: float | None

    def state(self) -> State:
        """All of it, for another process."""
        values = dataclasses.asdict(dataclasses.replace(self, start={}))
        return State({name: np.asarray(each) for name, each in self.start.items()}, values)

    @classmethod
    def of(cls, state: State) -> "Probe":
        """What `state` has made a state of.

        Raises:
          AttributeError, LookupError, TypeError, ValueError: if it is damaged.
        """
        values = dict(state.values)
        seconds = values["policy_seconds"]
        found = cls(
            units={str(name): float(unit) for name, unit in values["units"].items()},
            state_scales={
                str(name): (float(center), float(scale))
                for name, (center, scale) in values["state_scales"].items()
            },
            noop_return=float(values["noop_return"]),
            start={name: state.array(name, values.shape) for name, values in state.tensors.items()},
            start_return=float(values["start_return"]),
            deterministic=bool(values["deterministic"]),
            certain=bool(values["certain"]),
            policy_seconds=None if seconds is None else float(seconds),
        )
        sizes = [*found.units.values(), *(scale for _, scale in found.state_scales.values())]
        centers = [center for center, _ in found.state_scales.values()]
        for value in sizes:
            if not 0.0 < value < np.inf:
                raise ValueError(f"a unit is {value}, and not between 0 and infinity")
        if not np.isfinite(centers).all():
            raise ValueError(f"its centers are {centers!r:.40}, and not finite")
        return found

    def fits(self, planner: MDPOPlanner) -> bool:
        """Whether it can be of a planner's problem: its fluents and their shapes are.

        Args:
          planner: with a `FeedbackPlan`.
        """
        params = planner.feedback_plan.initializer(jax.random.PRNGKey(0), {}, None)
        shapes = {name: np.shape(own["bias"]) for name, own in params["own"].items()}
        starts = {name: values.shape for name, values in self.start.items()}
        seen = planner.rddl.observ_fluents or planner.rddl.state_fluents
        is_of_the_states = set(self.state_scales) == set(seen)
        return starts == shapes and set(self.units) <= set(shapes) and is_of_the_states


def probe(
    planner: MDPOPlanner, seed: int, until: float = math.inf, clock: Clock = time.monotonic
) -> Probe:
    """Plays constant actions on the exact model.

    Args:
      planner: with a `FeedbackPlan` without scales, whose units are 1 where there is no box.
      seed: of the actions and of the model.
      until: when to end at the latest, by the clock, once two were played.
      clock: what is asked for the time.
    """
    large = is_large(planner)
    count, rollouts = (_FEW_STARTS, 1) if large else (_STARTS, _ROLLOUTS)
    play = compile_visits(planner, rollouts, side_by_side=1 if large else None)
    key = jax.random.PRNGKey(seed)
    params = planner.feedback_plan.initializer(key, {}, None)
    shapes = {name: np.shape(own["bias"]) for name, own in params["own"].items()}
    numbers = list(planner.feedback_plan.units)

    spreads: list[float] = []
    state_spreads: list[float] = []

    def returns(starts: list[dict[str, np.ndarray]]) -> tuple[np.ndarray, dict[str, Any]]:
        batch = jax.tree.map(
            lambda *leaves: jnp.stack(leaves), *[with_bias(params, s) for s in starts]
        )
        played, states = play(key, batch)
        each = np.asarray(played, float)
        spreads.append(float(np.max(np.ptp(each, axis=1))))
        state_spreads.extend(_spread(values) for values in states.values())
        means = np.mean(each, axis=1)
        return np.where(np.isfinite(means), means, -np.inf), states

    noop = {name: np.zeros(shape) for name, shape in shapes.items()}
    full = {name: np.ones(shape) for name, shape in shapes.items()}
    at_once = 1 if large else count
    open_ended = [
        name for name in numbers if box_width(*planner.feedback_plan.bounds[name]) is None
    ]
    others = [noop] if large else [noop, full, {n: _HALF * v for n, v in full.items()}]
    units = {
        name: _unit(name, others, lambda starts: _in_batches(returns, starts, at_once))
        for name in open_ended
    }
    random = np.random.default_rng(seed)
    places = boxes(planner, units)
    starts = [noop, full, *(_random_start(random, places) for _ in range(count - 2))]
    # the planner's units are 1 where there is no box
    scaled = [{name: units.get(name, 1.0) * v for name, v in s.items()} for s in starts]
    means, states = returns(scaled[:1] if large else scaled)
    seconds = 0.0
    for start in scaled[1:] if large else []:
        if seconds and clock() + seconds > until:
            break
        began = clock()
        more, states = returns([start])
        means, seconds = np.append(means, more), clock() - began
    best = int(np.argmax(means))
    scales = {
        name: (0.5, 0.5) if planner.rddl.variable_ranges[name] == "bool" else _scale(values)
        for name, values in states.items()
    }
    return Probe(
        units=units,
        state_scales=scales,
        noop_return=float(means[0]),
        start=starts[best],
        start_return=float(means[best]),
        deterministic=not any(spreads),
        certain=rollouts > 1 and not any(spreads) and not any(state_spreads),
        policy_seconds=seconds if large else None,
    )


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


def _in_batches(
    returns: Callable[[list[dict[str, np.ndarray]]], tuple[np.ndarray, Any]],
    starts: list[dict[str, np.ndarray]],
    size: int,
) -> np.ndarray:
    """Mean returns of any number of constants, so many at once: one program for all of them."""
    batches = [starts[first : first + size] for first in range(0, len(starts), size)]
    padded = [batch + [starts[0]] * (size - len(batch)) for batch in batches]
    return np.concatenate([returns(batch)[0] for batch in padded])[: len(starts)]


def with_bias(params: Params, bias: Mapping[str, np.ndarray]) -> Params:
    """Parameters whose policy adds a constant to each object's raw action."""
    own = {
        name: {**entries, "bias": jnp.asarray(bias[name], entries["bias"].dtype)}
        for name, entries in params["own"].items()
    }
    return {**params, "own": own}


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


def _spread(values: Any) -> float:
    """The largest difference between rollouts of one policy, of values [P, rollouts, ...]."""
    return float(np.max(np.ptp(np.asarray(values, float), axis=1), initial=0.0))


def _scale(values: Any) -> tuple[float, float]:
    """Median and spread of all values of a fluent, neither moved by a few that run away."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return 0.0, 1.0
    low, median, high = (float(q) for q in np.percentile(finite, [10, 50, 90]))
    # of a normal law they are 2.56 deviations apart
    spread = (high - low) / 2.56 or min(float(np.std(finite)), 1e3)
    return median, spread if spread > 1e-6 * max(1.0, abs(median)) else 1.0
