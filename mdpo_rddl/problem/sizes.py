"""How large a problem becomes once it is grounded, before anything of that size is made."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from pyRDDLGym.core.debug.decompiler import RDDLDecompiler
from pyRDDLGym.core.parser.expr import Expression
from pyRDDLGym.core.parser.rddl import RDDL

MOST_GROUND_FLUENTS = 2_000_000
"""Of all kinds together; pyRDDLGym gives each of them a name."""

MOST_PLAYED_FLUENTS = 500_000
"""Of state, observation and action; a rollout carries them all, and its gradient once more."""

MOST_STEPS = 100_000
"""Of an episode; a rollout holds something of each of them."""

MOST_STEP_FLUENTS = 1_000_000_000
"""Steps times ground fluents."""

MOST_VALUES = 50_000_000
"""Of one expression: a value for each combination of the objects that it ranges over."""

MOST_PART_VALUES = 200_000_000
"""Of all expressions with all their parts: what is computed at each step."""

MOST_STEP_VALUES = 20_000_000_000
"""Steps times these."""

MOST_NAME = 1_000
"""Characters of a fluent's or an object's name; ground fluents repeat them."""

_EXPRESSION = 120  # characters of one in a message
_PLAYED = ("state-fluent", "observ-fluent", "action-fluent")
_MANY = 10**15
_BYTES = 4  # of a value of the compiled model


def oversize(ast: RDDL, horizon: int | None = None) -> str | None:
    """What of a problem is too large, in words; None if nothing is.

    Names that are not defined count as one object: others complain of them.

    Args:
      ast: both files, parsed.
      horizon: of an episode; the instance's if None.
    """
    counts = _object_counts(ast)
    longest = max(map(len, _names(ast)), default=0)
    if longest > MOST_NAME:
        return f"a name has {longest:,} characters, at most {MOST_NAME:,} can be planned for"
    ground = played = 0
    params: dict[str, list[str]] = {}
    for variable in ast.domain.pvariables:
        params[variable.name] = list(variable.param_types or ())
        count = math.prod(counts.get(name, 1) for name in params[variable.name])
        ground += count
        played += count if variable.fluent_type in _PLAYED else 0
    if ground > MOST_GROUND_FLUENTS:
        return f"{ground:,} ground fluents, at most {MOST_GROUND_FLUENTS:,} can be planned for"
    if played > MOST_PLAYED_FLUENTS:
        return (
            f"{played:,} ground fluents of state, observation and action, "
            f"at most {MOST_PLAYED_FLUENTS:,} can be planned for"
        )
    horizon = ast.instance.horizon if horizon is None else horizon
    most_steps = min(MOST_STEPS, MOST_STEP_FLUENTS // max(ground, 1))
    if horizon > most_steps:
        steps = f"{horizon:,}" if horizon < _MANY else f"over {_MANY:,}"
        return f"the horizon is {steps}, {_shorter(most_steps)}"
    return _too_many_values(ast, params, counts, horizon)


def step_values(ast: RDDL) -> int:
    """How many values all expressions with all their parts have: what is computed at a step.

    Args:
      ast: both files, parsed.
    """
    params = {each.name: list(each.param_types or ()) for each in ast.domain.pvariables}
    counts = _object_counts(ast)
    return sum(of_parts for _, _, of_parts in _sizes(ast, params, counts))


def long_integer(ast: RDDL) -> tuple[str, str] | None:
    """The first integer of more than 32 bits, with which no compiled model can compute.

    Args:
      ast: both files, parsed.

    Returns:
      "domain" or "instance", whose file holds it, and what it is, in words; None if there is none.
    """
    for name, _, expression in _expressions(ast, {}):
        for value, around in _literals(expression):
            if _is_long(value):
                return "domain", f"{name}, {expression_text(around)}: {_is_too_long(value)}"
    ranges = {each.name: each.range for each in ast.domain.pvariables}
    given = [
        ("domain", f"the default of {each.name}", each.range, each.default)
        for each in ast.domain.pvariables
    ]
    for block, attribute in ((ast.non_fluents, "init_non_fluent"), (ast.instance, "init_state")):
        for (name, objects), value in getattr(block, attribute, None) or ():
            whose = f"{name}({', '.join(objects)})" if objects else name
            given.append(("instance", f"the value of {whose}", ranges.get(name), value))
    for file, what, kind, value in given:
        if kind == "int" and _is_long(value):
            return file, f"{what}: {_is_too_long(value)}"
    return None


def _literals(expression: Any) -> Iterator[tuple[Any, Any]]:
    """Each number of an expression, with the expression that it is an operand of."""
    waiting = [(expression, expression)]
    while waiting:  # no recursion: expressions may be nested as deep as anybody likes
        node, around = waiting.pop()
        parts = node
        while isinstance(parts, Expression):
            parts = parts._expr
        if not isinstance(parts, tuple | list):
            continue
        if parts and parts[0] == "number":
            yield parts[1], around
        else:
            within = node if isinstance(node, Expression) else around
            waiting += [(part, within) for part in reversed(parts)]


def expression_text(expression: Any) -> str:
    """An expression as RDDL, on one line of bounded length."""
    text = " ".join(RDDLDecompiler().decompile_expr(expression).split())
    return text if len(text) <= _EXPRESSION else text[: _EXPRESSION - 1] + "…"


def _is_long(value: Any) -> bool:
    is_integer = isinstance(value, int) and not isinstance(value, bool)
    return is_integer and not -(2**31) <= value < 2**31


def _is_too_long(value: int) -> str:
    return (
        f"the integer {value} has more than 32 bits, with which compiled models compute; "
        f"a real holds it: {value}.0"
    )


def _sizes(
    ast: RDDL, params: dict[str, list[str]], counts: dict[str, int]
) -> Iterator[tuple[str, int, int]]:
    """Of each expression its name, the most values of a part, and the values of all parts."""
    for name, scope, expression in _expressions(ast, params):
        around = math.prod(counts.get(each, 1) for each in scope)
        yield name, *_values(expression, around, counts)


def _too_many_values(
    ast: RDDL, params: dict[str, list[str]], counts: dict[str, int], horizon: int
) -> str | None:
    """What of the expressions is too large, in words; None if nothing is.

    Args:
      ast: both files, parsed.
      params: per fluent, the types of its parameters.
      counts: objects per type.
      horizon: of an episode.
    """
    total = 0
    for name, values, of_parts in _sizes(ast, params, counts):
        total += of_parts
        if values > MOST_VALUES:
            return (
                f"{name} ranges over {values:,} combinations of objects, "
                f"at most {MOST_VALUES:,} can be planned for"
            )
        if of_parts > MOST_PART_VALUES:
            return _too_much(name, of_parts)
    if total > MOST_PART_VALUES:
        return _too_much("the domain", total)
    most_steps = MOST_STEP_VALUES // max(total, 1)
    if horizon > most_steps:
        of = f" of {total:,} values"
        return f"the horizon is {horizon:,}, {_shorter(most_steps, of)}"
    return None


def _shorter(most: int, of: str = "") -> str:
    """That a horizon is too long, and what to do."""
    what = f"at most {most:,} steps{of} can be planned for"
    return f"{what}: --horizon {most}" if most > 0 else what


def _too_much(name: str, values: int) -> str:
    return (
        f"{name} has {values:,} values with all its parts, "
        f"about {values * _BYTES / 2**30:.1f} GiB at each step; "
        f"at most {MOST_PART_VALUES:,} can be planned for"
    )


def _objects(ast: RDDL) -> Iterator[tuple[str, Sequence[str]]]:
    """Each type with its objects; an enumerated one with its values."""
    for name, kind in getattr(ast.domain, "types", None) or ():
        if isinstance(kind, list | tuple):
            yield name, kind
    for block in (ast.non_fluents, ast.instance):
        for name, objects in getattr(block, "objects", None) or ():
            yield name, objects or ()


def _object_counts(ast: RDDL) -> dict[str, int]:
    return {name: len(objects) for name, objects in _objects(ast)}


def _names(ast: RDDL) -> Iterator[str]:
    yield from (variable.name for variable in ast.domain.pvariables)
    for name, objects in _objects(ast):
        yield from (name, *objects)


def _expressions(ast: RDDL, params: dict[str, list[str]]) -> Iterator[tuple[str, list[str], Any]]:
    """A name, the types of the parameters and the expression, of all that the domain defines."""
    for cpf in ast.domain.cpfs[1]:
        name = cpf.pvar[1][0]
        yield f"the cpf of {name}", params.get(name.removesuffix("'"), []), cpf.expr
    yield "the reward", [], ast.domain.reward
    for what, attribute in (
        ("a precondition", "preconds"),
        ("a constraint", "constraints"),
        ("an invariant", "invariants"),
        ("a termination condition", "terminals"),
    ):
        for expression in getattr(ast.domain, attribute, None) or ():
            yield what, [], expression


def _values(expression: Any, values: int, counts: dict[str, int]) -> tuple[int, int]:
    """The largest number of values of an expression and its parts, and the sum of them all.

    A determinant, or an inverse, of n rows counts n^3 for what is computed on the way.

    Args:
      expression: pyRDDLGym's.
      values: of whatever stands around it, at least 1.
      counts: objects per type.
    """
    most, total, waiting = values, 0, [(expression, values)]
    while waiting:  # no recursion: expressions may be nested as deep as anybody likes
        node, around = waiting.pop()
        parts = node
        while isinstance(parts, Expression):  # one inside the other where there are parentheses
            parts = parts._expr
        if isinstance(node, Expression):
            is_matrix = node.etype[0] == "matrix"
            total += around * (_rows(parts, around, counts) if is_matrix else 1)
        if not isinstance(parts, tuple | list):
            continue
        ranges = [part[1][1] for part in parts if _is_quantifier(part)]
        around *= math.prod(counts.get(name, 1) for name in ranges)
        most = max(most, around)
        waiting += [(part, around) for part in parts if not _is_quantifier(part)]
    return most, total


def _rows(parts: Any, around: int, counts: dict[str, int]) -> int:
    """Rows of what a matrix's expression has, times those values of it that `around` lacks.

    Args:
      parts: the operation, and what it is of: quantifiers of a determinant, names of others.
      around: values of whatever stands around it.
      counts: objects per type.
    """
    ranges = [part[1][1] for part in parts[1] if _is_quantifier(part)]
    if ranges:
        return int(math.prod(counts.get(name, 1) for name in ranges) ** 1.5)
    return min(math.isqrt(around), max(counts.values(), default=1))


def _is_quantifier(part: Any) -> bool:
    return isinstance(part, tuple) and len(part) == 2 and part[0] == "typed_var"
