"""Action preconditions that forbid single bools: "if this is done, that must hold".

Logistics' rule, for one,

    forall_{?t : truck, ?c : city} [doDockAt(?t, ?c) => truckAt(?t, ?c)]

says of each bool on its own in which states it may be true, whatever the other actions are.
"""

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Implication:
    """One part of a precondition: where `action` is true, `condition` must hold.

    Attributes:
      action: a bool action fluent.
      axes: for each axis of the action, the place of its variable among those of the `forall`s.
      sizes: number of objects of each variable of the `forall`s.
      names: of these variables.
      condition: the expression on the right.
      given: expressions on the left beside the action; where one is false nothing must hold.
    """

    action: str
    axes: tuple[int, ...]
    sizes: tuple[int, ...]
    names: tuple[str, ...]
    condition: Any
    given: tuple[Any, ...]


@dataclass(frozen=True)
class Comparison:
    """A part of a precondition that compares numbers: `sign * left <= right`.

    Attributes:
      operator: "<=", "<" or "==".
      sign: of `left`, 1 or -1.
      left, right: expressions.
      variables: of the `forall`s around it, with their types.
      guards: expressions, whether each must be true for the comparison to be asked for, and how
        many of the variables are in its scope.
    """

    operator: str
    sign: int
    left: Any
    right: Any
    variables: Mapping[str, str]
    guards: tuple[tuple[Any, bool, int], ...]

    @property
    def sides(self) -> tuple[Any, Any]:
        """Both expressions."""
        return self.left, self.right


@dataclass(frozen=True)
class Rules:
    """What the preconditions of a problem ask of an action.

    Attributes:
      implications: those that forbid single bools.
      others: places in `rddl.preconditions` of those that name an action and are neither a box
        nor made of implications.
    """

    implications: tuple[Implication, ...]
    others: tuple[int, ...]


def read_rules(rddl: Any) -> Rules:
    """Reads the preconditions of pyRDDLGym's lifted model."""
    implications: list[Implication] = []
    others = []
    for place, precondition in enumerate(rddl.preconditions):
        names = set(rddl.action_fluents)
        if not fluents_of(precondition) & names or is_box(rddl, precondition):
            continue
        parts = list(conjuncts(precondition))
        found = [_read(rddl, expression, variables) for variables, expression in parts]
        if all(found):
            implications += [one for one in found if one is not None]
        else:
            others.append(place)
    return Rules(tuple(implications), tuple(others))


def is_box(rddl: Any, expression: Any, variables: Sequence[str] = ()) -> bool:
    """Whether a precondition only compares a numeric action with what never changes.

    `boxes.py` makes the same of it then: it knows no "&", and no object in two places.

    Args:
      rddl: pyRDDLGym's lifted model.
      expression: the precondition, or a part of it.
      variables: of the `forall`s around it.
    """
    while expression.etype == ("aggregation", "forall"):
        *typed, expression = expression.args
        variables = [*variables, *(name for _, (name, _) in typed)]
    if expression.etype == ("boolean", "^"):
        return all(is_box(rddl, argument, variables) for argument in expression.args)
    if expression.etype[0] != "relational" or expression.etype[1] not in ("<=", "<", ">=", ">"):
        return False
    numbers = {n for n in rddl.action_fluents if rddl.variable_ranges[n] in ("int", "real")}
    left, right = expression.args
    for one, other in ((left, right), (right, left)):
        is_number = one.etype[0] == "pvar" and fluents_of(one) <= numbers
        if is_number and fluents_of(other) <= set(rddl.non_fluents):
            free = [argument for argument in one.args[1] or [] if argument in variables]
            return len(set(free)) == len(free)
    return False


def conjuncts(expression: Any) -> Iterator[tuple[dict[str, str], Any]]:
    """The parts of a precondition that must all hold.

    Returns:
      Of each the variables of the `forall`s around it, with their types, and the expression.
    """
    return _conjuncts(expression, {})


def comparisons(expression: Any, numbers: Set[str]) -> Iterator[Comparison | None]:
    """The comparisons that must all hold for a precondition to hold.

    `abs[x] <= c` counts as two, and so do the branches of an `if`, each under a guard.

    Args:
      expression: the precondition.
      numbers: fluents that a guard may not read.

    Returns:
      Of each part the comparison, or None if it is none.
    """
    return _comparisons(expression, {}, (), numbers)


def _comparisons(
    expression: Any,
    variables: dict[str, str],
    guards: tuple[tuple[Any, bool, int], ...],
    numbers: Set[str],
) -> Iterator[Comparison | None]:
    arguments = expression.args
    if expression.etype == ("aggregation", "forall"):
        *typed, body = arguments
        inner = dict(variable for _, variable in typed)
        if inner.keys() & variables.keys():
            yield None
        else:
            yield from _comparisons(body, variables | inner, guards, numbers)
    elif _is_and(expression):
        for argument in arguments:
            yield from _comparisons(argument, variables, guards, numbers)
    elif expression.etype[0] == "relational":
        yield from _compared(expression, variables, guards)
    else:
        branches = _branches(expression, numbers)
        for chosen, truth, others in branches:
            own = tuple((other, truth, len(variables)) for other in others)
            yield from _comparisons(chosen, variables, guards + own, numbers)
        if not branches:
            yield None


def _branches(expression: Any, numbers: Set[str]) -> list[tuple[Any, bool, list[Any]]]:
    """What must hold, of an expression, where all of the other ones are true, or are false."""
    arguments = expression.args
    if expression.etype == ("boolean", "=>") and not fluents_of(arguments[0]) & numbers:
        return [(arguments[1], True, [arguments[0]])]
    if expression.etype == ("control", "if") and not fluents_of(arguments[0]) & numbers:
        return [(arguments[1], True, [arguments[0]]), (arguments[2], False, [arguments[0]])]
    if expression.etype == ("boolean", "|"):
        own = [each for each in arguments if fluents_of(each) & numbers]
        if len(own) == 1:
            return [(own[0], False, [each for each in arguments if each is not own[0]])]
    return []


def _compared(
    expression: Any, variables: dict[str, str], guards: tuple[tuple[Any, bool, int], ...]
) -> Iterator[Comparison | None]:
    left, right = expression.args
    operator = expression.etype[1]
    if operator in (">=", ">"):
        left, right, operator = right, left, {">=": "<=", ">": "<"}[operator]
    if operator not in ("<=", "<", "=="):
        yield None
    elif left.etype == ("func", "abs") and operator != "==":
        for sign in (1, -1):
            yield Comparison(operator, sign, left.args[0], right, variables, guards)
    else:
        yield Comparison(operator, 1, left, right, variables, guards)


def _conjuncts(expression: Any, variables: dict[str, str]) -> Iterator[tuple[dict[str, str], Any]]:
    if expression.etype == ("aggregation", "forall"):
        *typed, body = expression.args
        yield from _conjuncts(body, variables | dict(variable for _, variable in typed))
    elif _is_and(expression):
        for argument in expression.args:
            yield from _conjuncts(argument, variables)
    else:
        yield variables, expression


def _read(rddl: Any, expression: Any, variables: dict[str, str]) -> Implication | None:
    if expression.etype != ("boolean", "=>"):
        return None
    left, condition = expression.args
    actions = set(rddl.action_fluents)
    if fluents_of(condition) & actions:
        return None
    sides = left.args if _is_and(left) else [left]
    done = [side for side in sides if fluents_of(side) & actions]
    if len(done) != 1 or done[0].etype[0] != "pvar":
        return None
    name, arguments = done[0].args
    order = list(variables)
    if rddl.variable_ranges[name] != "bool" or not set(arguments or []) <= set(order):
        return None
    axes = tuple(order.index(argument) for argument in arguments or [])
    if len(set(axes)) != len(axes):
        return None
    sizes = tuple(len(rddl.type_to_objects[kind]) for kind in variables.values())
    given = tuple(side for side in sides if side is not done[0])
    return Implication(name, axes, sizes, tuple(order), condition, given)


def _is_and(expression: Any) -> bool:
    return expression.etype in (("boolean", "^"), ("boolean", "&"))


def fluents_of(expression: Any) -> set[str]:
    """Names of the fluents and non-fluents that an expression reads."""
    if isinstance(expression, tuple | list):
        return set().union(*map(fluents_of, expression))
    if not hasattr(expression, "etype"):
        return set()
    if expression.etype[0] == "pvar":
        name, arguments = expression.args
        own = set() if name[0] in "?@" else {name}  # an object stands here too
        return own | fluents_of(arguments or [])
    return fluents_of(expression.args) if isinstance(expression.args, tuple | list) else set()
