"""Bounds of integer actions that hang on the state, by intervals of what the state can be.

    sell <= stock        with  stock' = min[6, stock + buy - sell]
    if (is-on) then speed <= 10 else speed <= 0

An abstract interpretation (Cousot and Cousot, 1977): of each ground fluent an interval that holds
its values in all states that legal actions reach. Sums are followed as linear forms, and a form is
bounded together with the preconditions: of `stock + buy` the bound is 6 where a precondition says
`buy <= 6 - stock`, whatever the intervals of both are. Ends that go on moving become infinite.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from pyRDDLGym.core.simulator import RDDLSimulator

from mdpo_rddl.problem.implications import fluents_of, is_box

Ground = tuple[str, tuple[int, ...]]
Interval = tuple[float, float]
Box = tuple[Any, Any]

# steps for which the intervals are exact, before ends that move become infinite
_EXACT_ROUNDS = 50
# and what comes back from there
_NARROWINGS = 3
# expressions that are looked at, a second or so; with more there are no bounds
_MOST_EXPRESSIONS = 150_000
# alternatives of a condition that are told apart
_MOST_CASES = 64
# preconditions that are added to a form, one after the other
_MOST_ADDED = 4
_ROUNDING = 1e-9
_EVERYTHING = (-math.inf, math.inf)
_NOT_NEGATIVE = {
    "Poisson",
    "Exponential",
    "Weibull",
    "Gamma",
    "NegativeBinomial",
    "Geometric",
    "ChiSquare",
    "Pareto",
    "Gompertz",
}
_SHARES = {"Beta", "Kumaraswamy"}
_MONOTONE: dict[str, Callable[[float], Any]] = {
    "floor": math.floor,
    "ceil": math.ceil,
    "round": round,
    "sgn": np.sign,
}
_OPPOSITE = {"<=": ">", "<": ">=", ">=": "<", ">": "<=", "==": "~=", "~=": "=="}
_NEXT = "'"


class _Form(NamedTuple):
    """A sum of multiples of fluents and of something in an interval."""

    parts: Mapping[Ground, float]
    low: float
    high: float

    def times(self, factor: float) -> "_Form":
        """A multiple of it."""
        if factor == 0.0:
            return _Form({}, 0.0, 0.0)
        ends = sorted((self.low * factor, self.high * factor))
        return _Form({leaf: factor * each for leaf, each in self.parts.items()}, *ends)

    def plus(self, other: "_Form") -> "_Form":
        """The sum of both."""
        parts = dict(self.parts)
        for leaf, each in other.parts.items():
            parts[leaf] = parts.get(leaf, 0.0) + each
        parts = {leaf: each for leaf, each in parts.items() if each}
        return _Form(parts, self.low + other.low, self.high + other.high)

    def minus(self, other: "_Form") -> "_Form":
        """The difference."""
        return self.plus(other.times(-1.0))


_Case = tuple[_Form, ...]
"""Forms that are not above 0, all of them."""
_NOTHING_KNOWN: list[_Case] = [()]


class _TooLargeError(Exception):
    """There are too many expressions."""


# of each model; its boxes follow from it
_known: WeakKeyDictionary[Any, dict[str, Box]] = WeakKeyDictionary()


def with_reachable_bounds(simulator: RDDLSimulator, boxes: Mapping[str, Box]) -> dict[str, Box]:
    """The boxes, of which integer actions' infinite ends follow from preconditions on the state.

    A box holds every action that is legal in some state that legal actions reach.

    Args:
      simulator: of the problem; its state does not count.
      boxes: lower and upper bound [*shape] of each fluent that has them.
    """
    rddl = simulator.rddl
    if rddl not in _known:
        integers = {name for name in rddl.action_fluents if rddl.variable_ranges[name] == "int"}
        others = [each for each in rddl.preconditions if not is_box(rddl, each)]
        read = set().union(*map(fluents_of, others))
        _known[rddl] = _narrowed(simulator, boxes, sorted(integers & read))
    return {**boxes, **_known[rddl]}


def _narrowed(
    simulator: RDDLSimulator, boxes: Mapping[str, Box], names: Sequence[str]
) -> dict[str, Box]:
    """The boxes of some integer actions; nothing if that takes too long."""
    if not names:
        return {}
    try:
        ranges = _Analysis(simulator, boxes).action_ranges(names)
    except (_TooLargeError, RecursionError):
        return {}
    found: dict[str, Box] = {}
    for name in names:
        shape = np.shape(simulator.init_values[name])
        lower, upper = (np.array(np.broadcast_to(end, shape), float) for end in boxes[name])
        for place in np.ndindex(shape):
            low, high = ranges[name, place]
            if low <= high:  # else no state has a legal action
                # what has an end keeps it: a proposal beyond it still says what is wanted most
                if lower[place] == -np.inf:
                    lower[place] = np.ceil(low - _ROUNDING)
                if upper[place] == np.inf:
                    upper[place] = np.floor(high + _ROUNDING)
        found[name] = (lower, upper) if shape else (lower.item(), upper.item())
    return found


class _Analysis:
    """The intervals of a problem's fluents."""

    def __init__(self, simulator: RDDLSimulator, boxes: Mapping[str, Box]) -> None:
        self._rddl = rddl = simulator.rddl
        self._values, self._boxes = simulator.init_values, boxes
        self._count = 0
        self._known: dict[Ground, _Form] = {}
        self._ranges: dict[Ground, Interval] = {}
        self._static = {
            (name, place): self._static_range(name, place)
            for name in rddl.action_fluents
            for place in np.ndindex(np.shape(self._values[name]))
        }
        self._by_leaf: dict[Ground, list[_Form]] = {}

    def action_ranges(self, names: Sequence[str]) -> dict[Ground, Interval]:
        """The intervals of all ground actions.

        Args:
          names: those that are wanted.
        """
        states = self._states_behind(names)
        initial = {ground: (value, value) for ground, value in self._initial(states)}
        self._enter(initial)
        rounds = 0
        horizon = self._rddl.horizon
        while rounds < horizon - 1:
            found = self._next(states)
            merged = {ground: _hull(self._ranges[ground], found[ground]) for ground in found}
            if rounds >= _EXACT_ROUNDS:
                merged = {
                    ground: _widened(self._ranges[ground], merged[ground]) for ground in merged
                }
            before = self._ranges
            self._enter(merged)
            if all(before[ground] == self._ranges[ground] for ground in merged):
                break
            rounds += 1
        if rounds >= _EXACT_ROUNDS:
            for _ in range(_NARROWINGS):
                found = self._next(states)
                self._enter({ground: _hull(initial[ground], found[ground]) for ground in found})
        return {ground: self._ranges[ground] for ground in self._static}

    def _states_behind(self, names: Sequence[str]) -> list[str]:
        """The state fluents that preconditions on these actions read, directly or by others."""
        rddl, waiting, seen = self._rddl, list[str](), set[str]()
        for expression in (*rddl.preconditions, *rddl.invariants):
            read = fluents_of(expression)
            # others share actions or states with them
            waiting += read if read & set(names) else []
        actions = set(rddl.action_fluents)
        while waiting:
            name = waiting.pop()
            if name in seen:
                continue
            seen.add(name)
            if name in rddl.state_fluents:
                waiting += fluents_of(rddl.cpfs[name + _NEXT][1])
                # invariants and preconditions may keep it in its place
                for expression in (*rddl.preconditions, *rddl.invariants):
                    read = fluents_of(expression)
                    waiting += read if name in read else []
            elif name in rddl.cpfs:
                waiting += fluents_of(rddl.cpfs[name][1])
            elif name in actions:
                for expression in rddl.preconditions:
                    read = fluents_of(expression)
                    waiting += read if name in read else []
        return [name for name in rddl.state_fluents if name in seen]

    def _initial(self, states: Sequence[str]) -> Iterator[tuple[Ground, float]]:
        for name in states:
            values = np.asarray(self._values[name], float)
            for place in np.ndindex(values.shape):
                yield (name, place), float(values[place])

    def _static_range(self, name: str, place: tuple[int, ...]) -> Interval:
        if name not in self._boxes or self._rddl.variable_ranges[name] not in ("int", "real"):
            return self._kind_range(name)
        shape = np.shape(self._values[name])
        low, high = (float(np.broadcast_to(end, shape)[place]) for end in self._boxes[name])
        return low, high

    def _kind_range(self, name: str) -> Interval:
        kind = self._rddl.variable_ranges[name]
        if kind == "bool":
            return 0.0, 1.0
        if kind in self._rddl.type_to_objects:
            return 0.0, len(self._rddl.type_to_objects[kind]) - 1.0
        return _EVERYTHING

    def _enter(self, states: Mapping[Ground, Interval]) -> None:
        """Takes in the states' intervals, and works out the actions' from them."""
        self._known.clear()
        self._ranges = {**self._static, **states}
        self._by_leaf = {}
        conditions = [
            self._cases(part, binding, True)
            for expression in (*self._rddl.preconditions, *self._rddl.invariants)
            for part, binding in self._conjuncts(expression, {})
        ]
        # those without alternatives bound forms
        for form in [form for cases in conditions if len(cases) == 1 for form in cases[0]]:
            for leaf in form.parts:
                self._by_leaf.setdefault(leaf, []).append(form)
        conditions = [cases for cases in conditions if len(cases) > 1]
        # invariants hold where there is a next decision
        for ground in states:
            self._ranges[ground] = self._bounded(ground, conditions)
        # one action's bound may follow from another's
        for _ in range(2):
            for ground in self._static:
                self._ranges[ground] = self._bounded(ground, conditions)

    def _bounded(self, ground: Ground, conditions: Sequence[list[_Case]]) -> Interval:
        """The interval of a fluent as far as the conditions leave it."""
        own = _Form({ground: 1.0}, 0.0, 0.0)
        read = [
            cases
            for cases in conditions
            if any(ground in form.parts for case in cases for form in case)
        ]
        low, high = _around([self._range(own, case) for case in self._together(read, ())])
        before = self._ranges[ground]
        # nothing is legal then, and no step follows
        return (low, high) if low <= high else before

    def _next(self, states: Sequence[str]) -> dict[Ground, Interval]:
        """The intervals of the states after a step."""
        found: dict[Ground, Interval] = {}
        for name in states:
            least, most = self._kind_range(name)
            for place in np.ndindex(np.shape(self._values[name])):
                low, high = self._range(self._of_fluent(name + _NEXT, place, ()))
                low, high = max(low, least), min(high, most)
                if low > high or math.isnan(low) or math.isnan(high):
                    low, high = least, most
                if self._rddl.variable_ranges[name] == "int":
                    low, high = _whole(low, high)
                found[name, place] = low, high
        return found

    # forms

    def _range(self, form: _Form, case: _Case = ()) -> Interval:
        """The interval of a form, where the preconditions and the forms of a case hold."""
        return -self._highest(form.times(-1.0), case), self._highest(form, case)

    def _highest(self, form: _Form, case: _Case) -> float:
        infinite, finite = self._end(form)
        best = form
        for _ in range(_MOST_ADDED):
            limits = {id(each): each for leaf in best.parts for each in self._by_leaf.get(leaf, ())}
            tried = [
                best.minus(limit.times(factor))
                for limit in (*limits.values(), *case)
                for factor in {
                    best.parts[leaf] / each
                    for leaf, each in limit.parts.items()
                    if best.parts.get(leaf, 0.0) / each > 0.0
                }
                if math.isfinite(limit.low)
            ]
            self._spend(len(tried))
            # what a limit leaves below 0 at least is no more than its own constant part
            ends = [(self._end(each), number) for number, each in enumerate(tried)]
            if not ends or min(ends)[0] >= (infinite, finite):
                break
            (infinite, finite), number = min(ends)
            best = tried[number]
        return math.inf if infinite else finite

    def _end(self, form: _Form) -> tuple[int, float]:
        """How many parts are infinite at the form's upper end, and what the others add up to."""
        ends = [form.high]
        for leaf, factor in form.parts.items():
            low, high = self._ranges.get(leaf) or self._kind_range(leaf[0])
            ends.append(factor * (high if factor > 0.0 else low))
        infinite = [end for end in ends if not math.isfinite(end)]
        return len(infinite), sum(end for end in ends if math.isfinite(end))

    def _spend(self, count: int = 1) -> None:
        self._count += count
        if self._count > _MOST_EXPRESSIONS:
            raise _TooLargeError

    def _interval(self, expression: Any, binding: Mapping[str, int], case: _Case) -> Interval:
        return self._range(self._form(expression, binding, case), case)

    def _form(self, expression: Any, binding: Mapping[str, int], case: _Case) -> _Form:
        """The form of an expression, where the forms of a case hold."""
        self._spend()
        (kind, name), arguments = expression.etype, expression.args
        if kind == "constant":
            return _exactly(float(arguments))
        if kind == "pvar":
            return self._variable(arguments, binding, case)
        if kind == "arithmetic":
            return self._arithmetic(name, [self._form(a, binding, case) for a in arguments], case)
        if kind in ("relational", "boolean") or name in ("forall", "exists"):
            return _within(self._truth(expression, binding, case))
        if kind == "aggregation":
            *typed, body = arguments
            each = [self._form(body, inner, case) for inner in self._bindings(typed, binding)]
            return self._aggregated(name, each, case)
        if kind == "control":
            return self._chosen(expression, binding, case)
        if kind == "randomvar":
            return self._draw(name, arguments, binding, case)
        if kind == "func":
            ranges = [self._interval(each, binding, case) for each in arguments]
            return _within(_function(name, ranges))
        return _within(_EVERYTHING)

    def _variable(self, place: Any, binding: Mapping[str, int], case: _Case) -> _Form:
        name, arguments = place
        if name in binding:
            return _exactly(float(binding[name]))
        if arguments is None and name not in self._rddl.variable_types:
            return _exactly(float(self._rddl.object_to_index[name.removeprefix("@")]))
        indices = [
            range(len(self._rddl.type_to_objects[kind]))
            if not isinstance(each, str)
            else [binding[each] if each in binding else self._object(each)]
            for each, kind in zip(arguments or [], self._rddl.variable_params[name], strict=True)
        ]
        forms = [self._of_fluent(name, each, case) for each in product(*indices)]
        if len(forms) == 1:
            return forms[0]
        return _within(_around([self._range(form, case) for form in forms]))

    def _object(self, name: str) -> int:
        return int(self._rddl.object_to_index[name.removeprefix("@")])

    def _of_fluent(self, name: str, place: tuple[int, ...], case: _Case) -> _Form:
        rddl = self._rddl
        if rddl.variable_types[name] == "non-fluent":
            return _exactly(float(np.asarray(self._values[name], float)[place]))
        if name in rddl.state_fluents or name in rddl.action_fluents:
            low, high = self._ranges.get((name, place), _EVERYTHING)
            return _exactly(low) if low == high else _Form({(name, place): 1.0}, 0.0, 0.0)
        key = name, place
        if case or key not in self._known:
            parameters, expression = rddl.cpfs[name]
            variables = [variable for variable, _ in parameters or []]
            form = self._form(expression, dict(zip(variables, place, strict=True)), case)
            if case:
                return form
            self._known[key] = form
        return self._known[key]

    def _arithmetic(self, operator: str, forms: Sequence[_Form], case: _Case) -> _Form:
        first, *others = forms
        if operator == "-":
            if not others:
                return first.times(-1.0)
            return first.minus(others[0])
        for other in others:
            if operator == "+":
                first = first.plus(other)
            elif _is_constant(other) and (operator == "*" or other.low != 0.0):
                first = first.times(other.low if operator == "*" else 1.0 / other.low)
            elif operator == "*" and _is_constant(first):
                first = other.times(first.low)
            else:
                ranges = self._range(first, case), self._range(other, case)
                first = _within((_multiplied if operator == "*" else _divided)(*ranges))
        return first

    def _aggregated(self, name: str, forms: Sequence[_Form], case: _Case) -> _Form:
        if not forms:
            return _exactly({"sum": 0.0, "prod": 1.0}.get(name, math.nan))
        if name in ("sum", "avg"):
            total = self._arithmetic("+", forms, case)
            return total if name == "sum" else total.times(1.0 / len(forms))
        if name == "prod":
            return self._arithmetic("*", forms, case)
        if name in ("minimum", "maximum"):
            choose = min if name == "minimum" else max
            ranges = [self._range(form, case) for form in forms]
            return _within((choose(low for low, _ in ranges), choose(high for _, high in ranges)))
        return _within(_EVERYTHING)

    def _chosen(self, expression: Any, binding: Mapping[str, int], case: _Case) -> _Form:
        """What an `if` or a `switch` may choose, each where its condition holds."""
        if expression.etype[1] == "if":
            condition, yes, no = expression.args
            branches = [
                (branch, own)
                for branch, truth in ((yes, True), (no, False))
                for own in self._cases(condition, binding, truth, case)
            ]
        else:
            _, *choices = expression.args
            branches = [(e[1] if k == "case" else e, ()) for k, e in choices]
        if len(branches) == 1:
            ((branch, own),) = branches
            return (
                self._form(branch, binding, (*case, *own))
                if not own
                else _within(self._interval(branch, binding, (*case, *own)))
            )
        return _within(
            _around([self._interval(each, binding, (*case, *own)) for each, own in branches])
        )

    def _draw(self, name: str, arguments: Any, binding: Mapping[str, int], case: _Case) -> _Form:
        if name in ("KronDelta", "DiracDelta"):
            return self._form(arguments[0], binding, case)
        if name == "Bernoulli":
            return _within((0.0, 1.0))
        if name == "Uniform":
            ends = [self._interval(each, binding, case) for each in arguments]
            return _within(_around(ends))
        if name == "Binomial":
            return _within((0.0, max(self._interval(arguments[0], binding, case)[1], 0.0)))
        if name in _NOT_NEGATIVE:
            return _within((0.0, math.inf))
        return _within((0.0, 1.0) if name in _SHARES else _EVERYTHING)

    def _bindings(self, typed: Any, binding: Mapping[str, int]) -> Iterator[dict[str, int]]:
        variables = [variable for _, variable in typed]
        sizes = [range(len(self._rddl.type_to_objects[kind])) for _, kind in variables]
        names = [name for name, _ in variables]
        for places in product(*sizes):
            yield {**binding, **dict(zip(names, places, strict=True))}

    # conditions

    def _truth(self, expression: Any, binding: Mapping[str, int], case: _Case) -> Interval:
        may_hold = bool(self._cases(expression, binding, True, case))
        may_fail = bool(self._cases(expression, binding, False, case))
        return (0.0 if may_fail else 1.0), (1.0 if may_hold else 0.0)

    def _cases(
        self, expression: Any, binding: Mapping[str, int], truth: bool, case: _Case = ()
    ) -> list[_Case]:
        """The alternatives in which a condition is true, or is false, those that may be."""
        self._spend()
        (kind, name), arguments = expression.etype, expression.args
        if kind == "relational":
            operator = name if truth else _OPPOSITE[name]
            return self._possible(self._compared(operator, arguments, binding, case), case)
        if kind == "boolean" or name in ("forall", "exists"):
            return self._junction(expression, binding, truth, case)
        if kind == "control" and name == "if":
            condition, yes, no = arguments
            return self._any(
                self._all([(condition, binding, chosen), (branch, binding, truth)], case)
                for branch, chosen in ((yes, True), (no, False))
            )
        # a bool by itself
        form = self._form(expression, binding, case)
        wanted = _exactly(1.0).minus(form) if truth else form
        return self._possible([(wanted,)], case)

    def _junction(
        self, expression: Any, binding: Mapping[str, int], truth: bool, case: _Case
    ) -> list[_Case]:
        (_, name), arguments = expression.etype, expression.args
        parts: list[tuple[Any, Mapping[str, int], bool]]
        if name in ("forall", "exists"):
            *typed, body = arguments
            parts = [(body, inner, truth) for inner in self._bindings(typed, binding)]
            is_all = (name == "forall") == truth
        elif name in ("^", "&", "|"):
            parts = [(each, binding, truth) for each in arguments]
            is_all = (name != "|") == truth
        elif name == "=>":
            left, right = arguments
            parts, is_all = [(left, binding, not truth), (right, binding, truth)], not truth
        elif len(arguments) == 1:
            return self._cases(arguments[0], binding, not truth, case)
        elif name == "<=>":
            first, second = arguments
            return self._any(
                self._all([(first, binding, one), (second, binding, one == truth)], case)
                for one in (True, False)
            )
        else:
            return _NOTHING_KNOWN
        if is_all:
            return self._all(parts, case)
        return self._any(self._cases(*part, case) for part in parts)

    def _all(
        self, parts: Sequence[tuple[Any, Mapping[str, int], bool]], case: _Case
    ) -> list[_Case]:
        return self._together((self._cases(*part, case) for part in parts), case)

    def _together(self, conditions: Iterable[list[_Case]], case: _Case) -> list[_Case]:
        """The alternatives in which all of several conditions hold."""
        found: list[_Case] = [()]
        for cases in conditions:
            if not cases:
                return []
            # with more, what the part says is not made use of
            if len(found) * len(cases) > _MOST_CASES:
                continue
            joined = [(*one, *other) for one in found for other in cases]
            found = self._possible(joined, case) if len(cases) > 1 else joined
        return found

    def _conjuncts(
        self, expression: Any, binding: Mapping[str, int]
    ) -> Iterator[tuple[Any, Mapping[str, int]]]:
        """The parts of a condition that must all hold."""
        if expression.etype == ("aggregation", "forall"):
            *typed, body = expression.args
            for inner in self._bindings(typed, binding):
                yield from self._conjuncts(body, inner)
        elif expression.etype in (("boolean", "^"), ("boolean", "&")):
            for each in expression.args:
                yield from self._conjuncts(each, binding)
        else:
            yield expression, binding

    def _any(self, alternatives: Iterable[list[_Case]]) -> list[_Case]:
        found = [case for cases in alternatives for case in cases]
        return found if len(found) <= _MOST_CASES else _NOTHING_KNOWN

    def _possible(self, cases: Sequence[_Case], case: _Case) -> list[_Case]:
        """The cases whose forms can be at 0 or below."""
        return [
            tuple(form for form in own if form.parts)
            for own in cases
            if all(self._range(form, (*case, *own))[0] <= _ROUNDING for form in own)
        ]

    def _compared(
        self, operator: str, sides: Sequence[Any], binding: Mapping[str, int], case: _Case
    ) -> list[_Case]:
        """The alternatives in which a comparison holds."""
        left, right = sides if operator in ("<=", "<", "==", "~=") else reversed(sides)
        if operator in ("==", "~="):
            difference = self._form(left, binding, case).minus(self._form(right, binding, case))
            if operator == "==":
                return [(difference, difference.times(-1.0))]
            return [(self._strictly(each),) for each in (difference, difference.times(-1.0))]
        forms = [
            low.minus(high)
            for low in self._each(left, "max", binding, case)
            for high in self._each(right, "min", binding, case)
        ]
        return [tuple(map(self._strictly, forms) if operator in ("<", ">") else forms)]

    def _each(
        self, expression: Any, operator: str, binding: Mapping[str, int], case: _Case
    ) -> list[_Form]:
        """The forms whose largest, or smallest, an expression is."""
        if expression.etype == ("func", operator):
            return [
                form
                for each in expression.args
                for form in self._each(each, operator, binding, case)
            ]
        if expression.etype == ("func", "abs") and operator == "max":
            form = self._form(expression.args[0], binding, case)
            return [form, form.times(-1.0)]
        return [self._form(expression, binding, case)]

    def _strictly(self, form: _Form) -> _Form:
        """What is not above 0 where the form is below: of whole numbers one more."""
        kinds = (self._rddl.variable_ranges[name] for name, _ in form.parts)
        numbers = (form.low, *form.parts.values())
        is_whole = form.low == form.high and all(float(each).is_integer() for each in numbers)
        return form.plus(_exactly(1.0)) if is_whole and "real" not in kinds else form


def _exactly(value: float) -> _Form:
    return _within(_EVERYTHING) if math.isnan(value) else _Form({}, value, value)


def _within(interval: Interval) -> _Form:
    low, high = interval
    return _Form({}, -math.inf if math.isnan(low) else low, math.inf if math.isnan(high) else high)


def _is_constant(form: _Form) -> bool:
    return not form.parts and form.low == form.high and math.isfinite(form.low)


def _around(intervals: Sequence[Interval]) -> Interval:
    if not intervals:
        return _EVERYTHING
    return min(low for low, _ in intervals), max(high for _, high in intervals)


def _hull(one: Interval, other: Interval) -> Interval:
    return min(one[0], other[0]), max(one[1], other[1])


def _widened(before: Interval, after: Interval) -> Interval:
    """The interval after, with those ends that have moved at infinity."""
    return (
        before[0] if after[0] >= before[0] else -math.inf,
        before[1] if after[1] <= before[1] else math.inf,
    )


def _whole(low: float, high: float) -> Interval:
    ends = float(np.ceil(low - _ROUNDING)), float(np.floor(high + _ROUNDING))
    return ends if ends[0] <= ends[1] else (low, high)


def _multiplied(one: Interval, other: Interval) -> Interval:
    # nothing times infinity is nothing: the end is never reached
    ends = [0.0 if 0.0 in (x, y) else x * y for x in one for y in other]
    return min(ends), max(ends)


def _divided(one: Interval, other: Interval) -> Interval:
    if other[0] <= 0.0 <= other[1]:
        return _EVERYTHING
    return _multiplied(one, (1.0 / other[1], 1.0 / other[0]))


def _function(name: str, ranges: Sequence[Interval]) -> Interval:
    (low, high), *others = ranges
    if name in ("min", "max"):
        choose = min if name == "min" else max
        return choose(low, *(o[0] for o in others)), choose(high, *(o[1] for o in others))
    if name in _MONOTONE:
        low, high = (
            float(_MONOTONE[name](end)) if math.isfinite(end) else end for end in (low, high)
        )
        return low, high
    if name == "abs":
        return max(low, -high, 0.0), max(-low, high)
    if name == "sqrt":
        return math.sqrt(max(low, 0.0)), math.sqrt(max(high, 0.0))
    if name == "exp":
        return 0.0, math.exp(high) if high < 700.0 else math.inf
    if name in ("sin", "cos", "tanh"):
        return -1.0, 1.0
    if name in ("mod", "fmod") and others[0][0] > 0.0:
        return (
            (low, high)
            if low >= 0.0 and high < others[0][0]
            else (0.0, others[0][1] - (name == "mod"))
        )
    if name == "div" and others[0][0] > 0.0:
        low, high = _divided((low, high), others[0])
        return _function("floor", [(low, high)])
    return _EVERYTHING
