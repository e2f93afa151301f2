"""Legal actions for many states at once: the last layer of a policy on the simulator.

What a policy proposes may break a precondition or `max-nondef-actions`. It becomes a legal action
near it:

1. integers are clipped to the whole numbers in their box;
2. bools that an implication forbids are false, and the limits on groups choose among the others;
3. where that is still illegal, numbers go to the nearest point that keeps the preconditions that
   are linear in them (`mdpo_rddl.policy.linear`);
4. where that is no legal action, the no-op takes its changes one by one, the most probable first,
   each only if the action stays legal; of a number's change it takes a legal share, found by
   bisection; where the no-op itself is illegal, the most probable legal change of it comes first.
   Integers that a projection has rounded take what is left like that, too.

Where no legal action is found like that, the proposal stands.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from mdpo_rddl.planner.plans.limits import choose_within_limits
from mdpo_rddl.policy.linear import LinearLimits
from mdpo_rddl.problem.boxes import action_boxes
from mdpo_rddl.problem.implications import Implication, read_rules
from mdpo_rddl.problem.limits import GroupLimit, group_limits
from mdpo_rddl.simulator.simulator import Simulator, State

Actions = dict[str, np.ndarray]

# steps of a bisection, which ends at 1/256 of the way from the no-op to the proposal
_BISECTIONS = 8
# whole numbers and objects of at most so many values are tried one by one
_MOST_VALUES = 8


class LegalActions:
    """Makes proposals legal, as far as the preconditions tell.

    Attributes:
      is_needed: whether a proposal within its box and its groups' limits can be illegal at all.
    """

    def __init__(self, simulator: Simulator, limits: Sequence[GroupLimit]) -> None:
        """Reads the preconditions.

        Args:
          simulator: of the problem.
          limits: all limits on groups of bools that the policy keeps.
        """
        model = simulator.problem.model
        self._simulator, self._limits = simulator, list(limits)
        self._kinds = {name: model.variable_ranges[name] for name in simulator.actions}
        self._objects = {
            name: len(model.type_to_objects[kind])
            for name, kind in self._kinds.items()
            if kind in model.type_to_objects
        }
        boxes = action_boxes(model)
        self._integers = {
            name: (np.ceil(boxes[name][0]), np.floor(boxes[name][1]))
            for name, kind in self._kinds.items()
            if kind == "int"
        }
        rules = read_rules(model)
        self._implications = rules.implications
        expressions = [
            (expression, tuple(zip(rule.names, rule.sizes, strict=True)))
            for rule in self._implications
            for expression in (*rule.given, rule.condition)
        ]
        self._conditions = simulator.values_of(expressions) if expressions else None
        # the groups' limits are kept as they are, unless something is to be done everywhere
        unread = len(rules.others) - len(group_limits(model)[0])
        self._is_checked = unread > 0 or any(limit.exact for limit in self._limits)
        self._places, size = dict[str, slice](), 0
        for name in simulator.actions:
            count = math.prod(simulator.shapes[name])
            self._places[name], size = slice(size, size + count), size + count
        noop = [np.ravel(simulator.noop[name]).astype(float) for name in simulator.actions]
        self._noop = np.concatenate(noop) if noop else np.zeros(0)
        is_bool = [kind == "bool" for kind in self._kinds.values()]
        if model.max_allowed_actions < size:
            self._is_checked |= not all(is_bool) or bool(np.any(self._noop))
        self._is_bool, self._is_real, is_integer = map(self._of_kind, ("bool", "real", "int"))
        self._is_number = self._is_real | is_integer
        self._widths, lowest, highest = np.ones(size), np.full(size, -np.inf), np.full(size, np.inf)
        for name, (lower, upper) in {**boxes, **self._integers}.items():
            if self._kinds[name] in ("int", "real"):
                width = np.ravel(upper - lower)
                finite = np.isfinite(width) & (width > 0.0)
                place = self._places[name]
                self._widths[place] = np.where(finite, width, 1.0)
                lowest[place], highest[place] = np.ravel(lower), np.ravel(upper)
        numbers = self._is_number
        self._linear = LinearLimits(
            simulator,
            [model.preconditions[place] for place in rules.others],
            (lowest[numbers], highest[numbers]),
            is_integer[numbers],
            [name for name, kind in self._kinds.items() if kind in ("int", "real")],
        )
        self.is_needed = bool(self._integers or self._implications or self._is_checked)

    def __call__(
        self,
        proposal: Mapping[str, Any],
        preferences: Callable[[], Mapping[str, Any]],
        state: State,
    ) -> Actions:
        """Legal actions.

        Args:
          proposal: per action fluent [*shape, B].
          preferences: gives per bool action fluent the probability of true [*shape, B], or what is
            in its order.
          state: per fluent [*shape, B]; those that are missing have their initial values.
        """
        replicas = next(iter(proposal.values())).shape[-1]
        block, parts = self._simulator.block, []
        if replicas <= block:
            return self._made(dict(proposal), preferences, state)
        known = preferences()
        for first in range(0, replicas, block):
            which = slice(first, first + block)
            likely = partial(_of, known, which)
            parts.append(self._made(_of(proposal, which), likely, _of(state, which)))
        return {n: np.concatenate([part[n] for part in parts], axis=-1) for n in parts[0]}

    def allowed(self, state: State) -> Actions:
        """Which bools implications let be true, per action fluent [*shape, B] where they say it.

        Args:
          state: all fluents [*shape, B].
        """
        allowed: Actions = {}
        if self._conditions is None:
            return allowed
        parts = (value != 0 for value in self._conditions(state, {}))
        for rule in self._implications:
            mask = _holds(rule, parts)
            allowed[rule.action] = allowed[rule.action] & mask if rule.action in allowed else mask
        return allowed

    def _made(
        self, actions: Actions, preferences: Callable[[], Mapping[str, Any]], state: State
    ) -> Actions:
        for name, (lower, upper) in self._integers.items():
            value = np.clip(actions[name], lower[..., np.newaxis], upper[..., np.newaxis])
            actions[name] = value.astype(actions[name].dtype)
        if not (self._conditions or self._is_checked):
            return actions
        replicas = next(iter(actions.values())).shape[-1]
        state = {**self._simulator.initial(replicas), **state}
        if self._conditions is not None:
            actions = self._masked(actions, preferences, self.allowed(state))
        if not self._is_checked:
            return actions
        bad = np.flatnonzero(~self._simulator.legal(state, actions))
        if len(bad):
            known = preferences() if "bool" in self._kinds.values() else {}
            own = _of(actions, bad), _of(known, bad), _of(state, bad)
            for name, value in self._repaired(*own).items():
                actions[name] = np.array(actions[name])
                actions[name][..., bad] = value
        return actions

    def _masked(
        self,
        actions: Actions,
        preferences: Callable[[], Mapping[str, Any]],
        allowed: Actions,
    ) -> Actions:
        """The actions without the bools that implications forbid."""
        actions |= {name: actions[name] & mask for name, mask in allowed.items()}
        grouped = {name for limit in self._limits for name in limit.groups}
        if grouped & set(allowed):
            likely = preferences()
            left = {n: np.where(allowed.get(n, True), likely[n], 0.0) for n in grouped}
            actions |= choose_within_limits(left, self._limits)
        return actions

    def _repaired(
        self, actions: Actions, preferences: Mapping[str, np.ndarray], state: State
    ) -> Actions:
        """Legal actions near illegal ones of b replicas."""
        proposed = self._flat(actions)
        count = proposed.shape[1]
        noop = np.repeat(self._noop[:, np.newaxis], count, axis=1)
        scores = np.minimum(1.0, np.abs(proposed - noop) / self._widths[:, np.newaxis])
        for name, likely in preferences.items():
            place = self._places[name]
            true = np.reshape(likely, (-1, count))
            scores[place] = np.where(noop[place] > 0.5, 1.0 - true, true)
        near, is_near = self._projected(proposed, actions, state)
        base, found = np.where(is_near, near, noop), is_near | self._is_legal(noop, actions, state)
        if not found.all():
            self._start(base, found, proposed, (scores, actions, state))
        # a real that was projected has taken its share
        wanted = (proposed != base) & found & ~(is_near & self._is_real[:, np.newaxis])
        order = np.argsort(np.where(wanted, -scores, 1.0), axis=0, kind="stable")
        everyone = np.arange(count)
        for number in range(int(wanted.sum(axis=0).max(initial=0))):
            place = order[number]
            tried = base.copy()
            tried[place, everyone] = proposed[place, everyone]
            asked = wanted[place, everyone]
            legal = asked & self._is_legal(tried, actions, state)
            base[:, legal] = tried[:, legal]
            numbers = asked & ~legal & self._is_number[place]
            if numbers.any():
                self._approach(base, tried, place, (numbers, actions, state))
        base[:, ~found] = proposed[:, ~found]
        return self._tree(base, actions)

    def _projected(
        self, proposed: np.ndarray, actions: Actions, state: State
    ) -> tuple[np.ndarray, np.ndarray]:
        """Proposals with their numbers projected, and of which replicas these are legal [b]."""
        if not self._linear.is_needed:
            return proposed, np.zeros(proposed.shape[1], bool)
        like = {name: value[..., :0] for name, value in actions.items()}

        def of(numbers: np.ndarray, which: np.ndarray) -> Actions:
            flat = proposed[:, which]
            flat[self._is_number] = numbers
            return self._tree(flat, like)

        near = proposed.copy()
        near[self._is_number] = self._linear(proposed[self._is_number], of, state)
        return near, self._is_legal(near, actions, state)

    def _approach(
        self, base: np.ndarray, tried: np.ndarray, place: np.ndarray, given: tuple[Any, ...]
    ) -> None:
        """Moves one component of some replicas as far towards what was tried as is legal."""
        moving, actions, state = given
        everyone = np.arange(base.shape[1])
        start, end = base[place, everyone].copy(), tried[place, everyone].copy()
        share, step = np.zeros(len(everyone)), 0.5

        def moved(share: np.ndarray) -> np.ndarray:
            way = share * (end - start)
            return start + np.where(self._is_real[place], way, np.trunc(way))

        for _ in range(_BISECTIONS):
            nearer = base.copy()
            nearer[place, everyone] = moved(share + step)
            legal = moving & self._is_legal(nearer, actions, state)
            share = np.where(legal, share + step, share)
            step /= 2.0
        base[place[moving], everyone[moving]] = moved(share)[moving]

    def _start(
        self, base: np.ndarray, found: np.ndarray, proposed: np.ndarray, given: tuple[Any, ...]
    ) -> None:
        """Where the no-op is illegal, the most probable legal change of it."""
        scores, actions, state = given
        best = np.full(base.shape[1], -np.inf)
        for places, values in self._changes(proposed):
            tried = np.repeat(self._noop[:, np.newaxis], base.shape[1], axis=1)
            tried[places] = values
            width = self._widths[places][:, np.newaxis]
            near = 1.0 - np.minimum(1.0, np.abs(proposed[places] - tried[places]) / width)
            is_bool = self._is_bool[places][:, np.newaxis]
            score = np.where(is_bool, scores[places], near).mean(axis=0)
            # a change of many is the last resort
            score = score - 2.0 * (np.size(places) > 1)
            legal = ~found & (score > best)
            legal &= self._is_legal(tried, actions, state)
            base[:, legal], best[legal] = tried[:, legal], score[legal]
        found |= best > -np.inf

    def _changes(self, proposed: np.ndarray) -> Iterator[tuple[Any, Any]]:
        """Components and the values that they change to."""
        for name, place in self._places.items():
            kind, components = self._kinds[name], range(place.start, place.stop)
            for each in components:
                one = slice(each, each + 1)
                if kind == "bool":
                    yield one, 1.0 - self._noop[each]
                    continue
                yield one, proposed[one]
                for value in self._values(name, each - place.start):
                    yield one, value
            if kind == "bool" and len(components) > 1:
                yield place, (1.0 - self._noop[place])[:, np.newaxis]

    def _values(self, name: str, component: int) -> Sequence[float]:
        """All values of a component, if they are few."""
        if name in self._objects:
            lower, upper = 0.0, self._objects[name] - 1.0
        elif name in self._integers:
            lower, upper = (float(np.ravel(end)[component]) for end in self._integers[name])
        else:
            return ()
        if not upper - lower < _MOST_VALUES:
            return ()
        return [float(value) for value in np.arange(lower, upper + 1.0)]

    def _of_kind(self, kind: str) -> np.ndarray:
        found = np.zeros(len(self._noop), bool)
        for name, place in self._places.items():
            found[place] = self._kinds[name] == kind
        return found

    def _is_legal(self, flat: np.ndarray, like: Actions, state: State) -> np.ndarray:
        return self._simulator.legal(state, self._tree(flat, like))

    def _flat(self, actions: Actions) -> np.ndarray:
        return np.concatenate(
            [
                np.reshape(np.asarray(actions[name], float), (place.stop - place.start, -1))
                for name, place in self._places.items()
            ]
        )

    def _tree(self, flat: np.ndarray, like: Actions) -> Actions:
        return {
            name: flat[place].reshape(*like[name].shape[:-1], -1).astype(like[name].dtype)
            for name, place in self._places.items()
        }


def _holds(rule: Implication, values: Iterator[np.ndarray]) -> np.ndarray:
    """Which components of an action a rule allows to be true [*action shape, B].

    Args:
      rule: an implication.
      values: of its given parts and of its condition, which are taken.
    """
    given = [next(values) for _ in rule.given]
    whole = next(values)
    for each in given:
        whole = whole | ~each
    unused = tuple(set(range(len(rule.sizes))) - set(rule.axes))
    kept = sorted(rule.axes)
    order = [kept.index(axis) for axis in rule.axes]
    return np.transpose(np.all(whole, axis=unused), [*order, len(order)])


def _of(arrays: Mapping[str, np.ndarray], which: Any) -> dict[str, np.ndarray]:
    """The values of some replicas."""
    return {name: value[..., which] for name, value in arrays.items()}
