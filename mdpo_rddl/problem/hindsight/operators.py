"""RDDL's operators on what a plan decides, as rows of a linear program.

Where an operator is not linear, a variable stands for its result, and rows hold it to the right
values for every setting of switches (0 or 1). A comparison that holds with equality may count
either way, so that no plan is lost, and what is found is a bound.
"""

import math
from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np

from mdpo_rddl.problem.enumeration.operators import OPERATORS
from mdpo_rddl.problem.hindsight.functions import function_of_one
from mdpo_rddl.problem.hindsight.piecewise import Piecewise
from mdpo_rddl.problem.hindsight.program import Affine, NotLinearError, Program, Value

_LARGEST = 1e9
_MOST_TERMS = 8
_AFFINE = {"+", "-", "*", "/"}


def applied(
    program: Program, operator: str, arguments: Sequence[Value | Piecewise]
) -> Value | Piecewise:
    """The result of an operator of `mdpo_rddl.problem.enumeration.operators`.

    Raises:
      NotLinearError: if it is not piecewise linear in what a plan decides.
    """
    if not any(isinstance(each, (Affine, Piecewise)) for each in arguments):
        with np.errstate(all="ignore"):  # it may be the branch that is not taken
            value = np.asarray(OPERATORS[operator](*arguments))
        return bool(value) if value.dtype == bool else float(value)
    is_function = operator not in _AFFINE or any(isinstance(a, Piecewise) for a in arguments)
    function = function_of_one(program, operator, arguments) if is_function else None
    if function is not None:
        return function if len(function.pieces) > 1 else function.written(program)
    rule = _RULES.get(operator)
    if rule is None:
        raise NotLinearError(f"{operator} of what the actions change")
    result = rule(program, *(written(program, each) for each in arguments))
    return program.named(result, _MOST_TERMS)


def written(program: Program, value: Value | Piecewise) -> Value:
    """A value in the terms of the program's variables, the same one each time."""
    if not isinstance(value, Piecewise):
        return value
    if value not in program.functions:
        program.functions[value] = value.written(program)
    return program.functions[value]


def _sum(program: Program, *arguments: Value) -> Value:
    total: dict[int, float] = {}
    constant = 0.0
    for each in arguments:
        if not isinstance(each, Affine):
            constant += each
            continue
        constant += each.constant
        for variable, factor in each.terms.items():
            total[variable] = total.get(variable, 0.0) + factor
    return Affine(constant, total)


def _difference(program: Program, first: Value, second: Value) -> Value:
    return first - second


def _product(program: Program, *arguments: Value) -> Value:
    return reduce(lambda x, y: _times(program, x, y), arguments)


def _times(program: Program, first: Value, second: Value) -> Value:
    if not isinstance(first, Affine):
        return first * second
    if not isinstance(second, Affine):
        return second * first
    if first.is_bool and second.is_bool:
        return _and(program, first, second)
    if first.is_bool:
        return _choice(program, first, second, 0.0)
    if second.is_bool:
        return _choice(program, second, first, 0.0)
    raise NotLinearError("a product of two fluents that the actions change")


def _quotient(program: Program, first: Value, second: Value) -> Value:
    if isinstance(second, Affine):
        raise NotLinearError("a division by what the actions change")
    if not second:
        raise NotLinearError("a division by 0")
    return (1.0 / second) * first


def _power(program: Program, base: Value, exponent: Value) -> Value:
    if exponent == 1:
        return base
    raise NotLinearError("a power of what the actions change")


def _maximum(program: Program, *arguments: Value) -> Value:
    return reduce(lambda x, y: _larger(program, x, y), arguments)


def _minimum(program: Program, *arguments: Value) -> Value:
    return reduce(lambda x, y: _smaller(program, x, y), arguments)


def _larger(program: Program, first: Value, second: Value) -> Value:
    gap = first - second
    low, high = program.interval(gap)
    if low >= 0.0:
        return first
    if high <= 0.0:
        return second
    ends = program.interval(first), program.interval(second)
    result = program.variable(max(e[0] for e in ends), max(e[1] for e in ends))
    is_first = program.switch()
    program.relate(result, at_least=first)
    program.relate(result, at_least=second)
    low, high = _finite(low), _finite(high)
    program.require(result - first - low * is_first, upper=-low)
    program.require(result - second - high * is_first, upper=0.0)
    return result


def _smaller(program: Program, first: Value, second: Value) -> Value:
    gap = first - second
    low, high = program.interval(gap)
    if high <= 0.0:
        return first
    if low >= 0.0:
        return second
    ends = program.interval(first), program.interval(second)
    result = program.variable(min(e[0] for e in ends), min(e[1] for e in ends))
    is_second = program.switch()
    program.relate(result, at_most=first)
    program.relate(result, at_most=second)
    low, high = _finite(low), _finite(high)
    program.require(result - first + high * is_second, lower=0.0)
    program.require(result - second + low * is_second, lower=low)
    return result


def _absolute(program: Program, value: Value) -> Value:
    return _larger(program, value, -1.0 * value)


def _choice(program: Program, condition: Value, yes: Value, no: Value) -> Value:
    """If-then-else."""
    if not isinstance(condition, Affine):
        return yes if condition else no
    low, high = program.interval(yes - no)
    if low == high == 0.0:
        return yes
    low, high = _finite(low), _finite(high)
    ends = program.interval(yes), program.interval(no)
    result = program.variable(min(e[0] for e in ends), max(e[1] for e in ends))
    # result - no is between 0 and 0, or it is yes - no
    program.require(result - no - high * condition, upper=0.0)
    program.require(result - no - low * condition, lower=0.0)
    program.require(result - yes - low * condition, upper=-low)
    program.require(result - yes - high * condition, lower=-high)
    is_bool = all(_is_bool(each) for each in (yes, no))
    return Affine(result.constant, result.terms, is_bool)


def _and(program: Program, *arguments: Value) -> Value:
    left = [each for each in arguments if isinstance(each, Affine)]
    if not all(each for each in arguments if not isinstance(each, Affine)):
        return False
    if len(left) < 2:
        return left[0] if left else True
    result = program.variable(0.0, 1.0)
    for each in left:
        program.require(result - each, upper=0.0)
    program.require(result - _sum(program, *left), lower=1.0 - len(left))
    return Affine(result.constant, result.terms, is_bool=True)


def _not(program: Program, value: Value) -> Value:
    if not isinstance(value, Affine):
        return not value
    negated = 1.0 - value
    return Affine(negated.constant, negated.terms, is_bool=True)


def _or(program: Program, *arguments: Value) -> Value:
    return _not(program, _and(program, *(_not(program, each) for each in arguments)))


def _at_least(program: Program, first: Value, second: Value) -> Value:
    gap = first - second
    low, high = program.interval(gap)
    if low >= 0.0:
        return True
    if high < 0.0:
        return False
    return _sign(program, gap, low, high)


def _more(program: Program, first: Value, second: Value) -> Value:
    gap = first - second
    low, high = program.interval(gap)
    if low > 0.0:
        return True
    if high <= 0.0:
        return False
    return _sign(program, gap, low, high)


def _sign(program: Program, gap: Value, low: float, high: float) -> Affine:
    """Whether the gap is positive; either way where it is 0."""
    low, high = _finite(low), _finite(high)
    is_more = program.switch()
    program.require(gap + low * is_more, lower=low)
    program.require(gap - high * is_more, upper=0.0)
    return is_more


def _equal(program: Program, first: Value, second: Value) -> Value:
    if _is_bool(first) and _is_bool(second):
        return _not(program, _different_bools(program, first, second))
    gap = first - second
    low, high = program.interval(gap)
    if low > 0.0 or high < 0.0:
        return False
    low, high = _finite(low), _finite(high)
    is_equal = program.switch()
    program.require(gap + high * is_equal, upper=high)
    program.require(gap + low * is_equal, lower=low)
    return is_equal


def _different_bools(program: Program, first: Value, second: Value) -> Value:
    if not isinstance(first, Affine):
        return _not(program, second) if first else second
    if not isinstance(second, Affine):
        return _not(program, first) if second else first
    result = program.variable(0.0, 1.0)
    program.require(result - (first - second), lower=0.0)
    program.require(result - (second - first), lower=0.0)
    program.require(result - (first + second), upper=0.0)
    program.require(result + (first + second), upper=2.0)
    return Affine(result.constant, result.terms, is_bool=True)


def _is_bool(value: Value) -> bool:
    return value.is_bool if isinstance(value, Affine) else isinstance(value, bool)


def _finite(end: float) -> float:
    if not math.isfinite(end) or abs(end) > _LARGEST:
        raise NotLinearError("a fluent or an action without bounds")
    return end


_RULES: dict[str, Callable[..., Value]] = {
    "+": _sum,
    "-": _difference,
    "*": _product,
    "/": _quotient,
    "pow": _power,
    "maximum": _maximum,
    "max": _maximum,
    "minimum": _minimum,
    "min": _minimum,
    "abs": _absolute,
    "if": _choice,
    "and": _and,
    "or": _or,
    "not": _not,
    "iff": _equal,
    "==": _equal,
    "xor": _different_bools,
    "~=": lambda program, x, y: _not(program, _equal(program, x, y)),
    ">=": _at_least,
    "<=": lambda program, x, y: _at_least(program, y, x),
    ">": _more,
    "<": lambda program, x, y: _more(program, y, x),
}
