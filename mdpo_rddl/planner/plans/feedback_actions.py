"""What a feedback policy plays: from raw actions, which have no units, to the problem's."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mdpo_rddl.planner.plans.features import array_module
from mdpo_rddl.planner.plans.feedback import Feedback, Params
from mdpo_rddl.planner.plans.limits import choose_within_limits
from mdpo_rddl.problem.boxes import box_width
from mdpo_rddl.problem.limits import GroupLimit, concurrency_limits

# a bool's log-odds for a raw value of 1
BOOL_SCALE = 4.0

Arrays = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class FeedbackActions:
    """Plays no-op + unit * u, clipped to the box, u being the raw action of `Feedback`.

    For bools u is, up to a factor, the log-odds of not being at the no-op. Like the raw actions
    these are one formula for JAX and for numpy, where arrays have a last axis of replicas.

    Attributes:
      feedback: the raw actions.
      noop: per action fluent [*shape]; of bools as bools.
      units: per real or integer action fluent what a raw value of 1 means [*shape].
      bounds: per action fluent its box.
      integers: the action fluents that are rounded.
      kinds: the types of reals and of integers.
      limits: what keeps `max-nondef-actions`, if bools can.
    """

    feedback: Feedback
    noop: Mapping[str, np.ndarray]
    units: Mapping[str, np.ndarray]
    bounds: Mapping[str, Any]
    integers: Sequence[str]
    kinds: tuple[Any, Any]
    limits: Sequence[GroupLimit]

    @classmethod
    def of(
        cls,
        feedback: Feedback,
        rddl: Any,
        values: Mapping[str, Any],
        units: Mapping[str, float],
        bounds: Mapping[str, Any],
        kinds: tuple[Any, Any],
    ) -> "FeedbackActions":
        """The actions of a problem.

        Args:
          feedback: the raw actions.
          rddl: pyRDDLGym's lifted model.
          values: per action fluent its no-op [*shape]; a relaxed model's bools are numbers.
          units: per real or integer action fluent what a raw value of 1 means; where it is not
            named the width of its box, or 1 if it has none.
          bounds: per action fluent its box.
          kinds: the types of reals and of integers.
        """
        shapes, ranges = feedback.action_shapes, rddl.variable_ranges
        noop = {
            name: np.asarray(values[name]) > 0.5
            if ranges[name] == "bool"
            else np.asarray(values[name])
            for name in shapes
        }
        numbers = [name for name in shapes if ranges[name] != "bool"]
        known = {
            name: np.full(shapes[name], units[name] if name in units else _unit(rddl, name, bounds))
            for name in numbers
        }
        whole = [name for name in numbers if ranges[name] != "real"]
        return cls(feedback, noop, known, bounds, whole, kinds, concurrency_limits(rddl, shapes))

    def on_numpy(self) -> "FeedbackActions":
        """The same formula on numpy, for replicas of the state."""
        return replace(self, feedback=self.feedback.on_numpy())

    @property
    def bools(self) -> list[str]:
        """The bool action fluents."""
        return [name for name in self.feedback.action_shapes if name not in self.units]

    def relaxed(
        self, params: Params, state: Arrays, step: Any, squash: Callable[[Any], Any]
    ) -> dict[str, Any]:
        """Numbers in their box, and of bools the squashed log-odds of not being at the no-op.

        Args:
          params: of the policy.
          state: per observed fluent [*shape], and the entries of the memory; of replicas
            [*shape, B].
          step: of the rollout, from 0.
          squash: of log-odds.

        Returns:
          Per action fluent as many.
        """
        raw = self.feedback.raw(params, state, step)
        if self.feedback.is_replicated:
            count = next((np.shape(value)[-1] for value in state.values()), 1)
            raw = {n: np.broadcast_to(u, (*u.shape[:-1], count)) for n, u in raw.items()}
        actions = {name: squash(BOOL_SCALE * raw[name]) for name in self.bools}
        for name, unit in self.units.items():
            action = self._of_all(self.noop[name], name) + self._of_all(unit, name) * raw[name]
            action = action.astype(self.kinds[0])
            actions[name] = self._clipped(action, name)
        return actions

    def probabilities(
        self, params: Params, state: Arrays, step: Any, squash: Callable[[Any], Any]
    ) -> dict[str, Any]:
        """The same, but of bools the squashed log-odds of being true; `squash` as x -> 1 - x."""
        return self.flipped(self.relaxed(params, state, step, squash))

    def flipped(self, actions: Arrays) -> dict[str, Any]:
        """Of bools the probability of true, from that of not being at the no-op."""
        xp, true = self.feedback.xp, {}
        for name in self.bools:
            noop = self._of_all(self.noop[name], name)
            true[name] = xp.where(noop, 1.0 - actions[name], actions[name])
        return {**actions, **true}

    def played(
        self, params: Params, state: Arrays, step: Any, groups: Sequence[GroupLimit] = ()
    ) -> dict[str, Any]:
        """The action of a state, as `relaxed` takes it.

        Args:
          params: of the policy.
          state: see there.
          step: of the rollout, from 0.
          groups: limits on groups of bools that it keeps, too.
        """
        xp = self.feedback.xp
        actions = self.relaxed(params, state, step, in_order)
        chosen = choose_within_limits({name: actions[name] for name in self.bools}, self.limits)
        for name in self.bools:
            actions[name] = chosen[name] ^ self._of_all(self.noop[name], name)
        for name in self.integers:
            actions[name] = xp.asarray(xp.round(actions[name]), self.kinds[1])
        if groups:
            every = [*groups, *self.limits]
            likely = self.probabilities(params, state, step, sigmoid)
            names = {name for limit in every for name in limit.groups}
            actions |= choose_within_limits({name: likely[name] for name in sorted(names)}, every)
        return actions

    def remembered(self, memory: Arrays, step: Any, state: Arrays, actions: Arrays) -> Any:
        """The memory after a step, told of the actions as they were played.

        Args:
          memory: before it.
          step: of the rollout, from 0.
          state: per observed fluent.
          actions: per action fluent.
        """
        xp = self.feedback.xp
        units = {}
        for name, action in actions.items():
            moved = xp.asarray(action, self.feedback.dtype) - self._of_all(self.noop[name], name)
            is_number = name in self.units
            units[name] = moved / self._of_all(self.units[name], name) if is_number else abs(moved)
        return self.feedback.updated(memory, step, {**state, **units})

    def _of_all(self, value: Any, name: str) -> Any:
        return self.feedback.of_all(value, name)

    def _clipped(self, action: Any, name: str) -> Any:
        """Clips to the box; a value on a bound keeps its gradient."""
        xp, shape = self.feedback.xp, self.feedback.action_shapes[name]
        lower, upper = (xp.asarray(bound, action.dtype) for bound in self.bounds[name])
        if self.feedback.is_replicated:
            lower, upper = (np.broadcast_to(b, shape)[..., np.newaxis] for b in (lower, upper))
        return xp.where(action < lower, lower, xp.where(action > upper, upper, action))


def _unit(rddl: Any, name: str, bounds: Mapping[str, Any]) -> float:
    """What a raw value of 1 means where nobody says it."""
    kind = rddl.variable_ranges[name]
    if kind in rddl.type_to_objects:
        return max(1.0, len(rddl.type_to_objects[kind]) - 1.0)
    return box_width(*bounds[name]) or 1.0


def sigmoid(log_odds: Any) -> Any:
    """The probability of log-odds."""
    if array_module(log_odds) is np:
        with np.errstate(over="ignore"):
            return 1.0 / (1.0 + np.exp(-log_odds))
    from jax.nn import sigmoid as of_jax

    return of_jax(log_odds)


def in_order(log_odds: Any) -> Any:
    """Between 0 and 1, 0.5 for log-odds of 0; a sigmoid is 1 in 32 bit from 17 on."""
    return 0.5 + 0.5 * log_odds / (1.0 + abs(log_odds))
