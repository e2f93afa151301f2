"""What the operators of RDDL compute, over arrays as over numbers."""

from collections.abc import Callable
from functools import partial, reduce
from typing import Any

import numpy as np


def _whole(function: Callable[..., Any], *values: Any) -> Any:
    return np.asarray(function(*values)).astype(np.int64)


def _int(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with a whole-number result."""
    return partial(_whole, function)


def _of_bools(function: Callable[..., Any], *values: Any) -> Any:
    return reduce(function, values)


def _of_sizes(function: Callable[..., Any], *values: Any) -> Any:
    return reduce(function, (1 * value for value in values))


def _numeric(function: Callable[..., Any], *values: Any) -> Any:
    return function(*(1 * value for value in values))


def _of_numbers(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with bools taken as 0 and 1."""
    return partial(_numeric, function)


# whoever holds an operator can be pickled: there is no lambda
OPERATORS: dict[str, Callable[..., Any]] = {
    "and": partial(_of_bools, np.logical_and),
    "or": partial(_of_bools, np.logical_or),
    "not": np.logical_not,
    "iff": np.equal,
    "xor": np.logical_xor,
    "if": np.where,
    "+": partial(_of_sizes, np.add),
    "*": partial(_of_sizes, np.multiply),
    "-": _of_numbers(np.subtract),
    "/": _of_numbers(np.divide),
    "==": np.equal,
    "~=": np.not_equal,
    "<=": np.less_equal,
    "<": np.less,
    ">=": np.greater_equal,
    ">": np.greater,
    "minimum": partial(_of_sizes, np.minimum),
    "maximum": partial(_of_sizes, np.maximum),
}
OPERATORS |= {"min": OPERATORS["minimum"], "max": OPERATORS["maximum"]}
REDUCED: dict[str, np.ufunc] = {
    "and": np.logical_and,
    "or": np.logical_or,
    "minimum": np.minimum,
    "maximum": np.maximum,
    "min": np.minimum,
    "max": np.maximum,
}
"""Of those that take any number of arguments, in whatever order, what puts two together.

Sums and products are not among them: they would round otherwise for one value than for many."""


def _power(base: Any, exponent: Any) -> Any:
    """numpy's, but no number for an int with a negative exponent: it may be of no branch taken."""
    integers = all(np.issubdtype(np.asarray(each).dtype, np.integer) for each in (base, exponent))
    if not integers or not np.any(np.less(exponent, 0)):
        return np.power(base, exponent)
    return np.where(np.less(exponent, 0), np.nan, np.power(base, np.maximum(exponent, 0)))[()]


def _divided(function: Callable[..., Any], x: Any, y: Any) -> Any:
    is_zero = np.equal(y, 0)
    return np.where(is_zero, 0, function(x, np.where(is_zero, 1, y)))


def _whole_division(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function of whole numbers with a whole result: 0 where the divisor is."""
    return _int(partial(_divided, function))


def _logarithm(x: Any, base: Any) -> Any:
    return np.log(x) / np.log(base)


_ONE_ARGUMENT: dict[str, Callable[..., Any]] = {
    "abs": np.abs,
    "sgn": _int(np.sign),
    "round": _int(np.round),
    "floor": _int(np.floor),
    "ceil": _int(np.ceil),
    "cos": np.cos,
    "sin": np.sin,
    "tan": np.tan,
    "acos": np.arccos,
    "asin": np.arcsin,
    "atan": np.arctan,
    "cosh": np.cosh,
    "sinh": np.sinh,
    "tanh": np.tanh,
    "exp": np.exp,
    "ln": np.log,
    "sqrt": np.sqrt,
}
_TWO_ARGUMENTS: dict[str, Callable[..., Any]] = {
    "div": _whole_division(np.floor_divide),
    "mod": _whole_division(np.mod),
    "fmod": np.mod,
    "pow": _power,
    "log": _logarithm,
    "hypot": np.hypot,
}


FUNCTIONS = {
    name: _of_numbers(function) for name, function in (_ONE_ARGUMENT | _TWO_ARGUMENTS).items()
}
OPERATORS |= FUNCTIONS
FUNCTION_NAMES = {*FUNCTIONS, "min", "max"}

PARTIAL = {"/", "fmod", "pow", "log", "ln", "sqrt", "acos", "asin", "exp", "tan"}
PARTIAL |= {"cosh", "sinh"}
"""Operators whose result may be infinite or no number, of arguments that are finite."""
BOOL_OPERATORS = {"and", "or", "not", "iff", "xor", "==", "~=", "<=", "<", ">=", ">"}
"""Operators whose result is a bool."""
