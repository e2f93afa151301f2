"""What a program's constants tell of its other values, whatever it is given."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

NEUTRAL: dict[str, Any] = {
    "reduce_or": False,
    "reduce_and": True,
    "reduce_sum": 0,
    "reduce_prod": 1,
}
"""What changes nothing, per reduction."""
REDUCED: dict[str, Callable[..., Any]] = {
    "reduce_or": np.any,
    "reduce_and": np.all,
    "reduce_sum": np.sum,
    "reduce_prod": np.prod,
}
"""The reductions of constants."""
_COMPUTED: dict[str, Callable[..., Any]] = {
    "eq": np.equal,
    "ne": np.not_equal,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "neg": np.negative,
    "max": np.maximum,
    "min": np.minimum,
}
_LOOKED_AT = frozenset([*_COMPUTED, "and", "or", "not", "convert_element_type", "select_n"])


@dataclass(frozen=True)
class Known:
    """What is known of an array.

    Attributes:
      values: of its shape, or one that is broadcast to it; of no meaning where they are not known.
      where: at which entries they are known, likewise.
      is_finite: whether all entries are sure to be finite.
    """

    values: np.ndarray
    where: np.ndarray
    is_finite: bool

    @classmethod
    def all_of(cls, constant: Any) -> "Known":
        """All of a constant."""
        values = np.asarray(constant)
        return cls(values, np.array(True), bool(np.all(np.isfinite(values))))

    @classmethod
    def nothing(cls, dtype: Any) -> "Known":
        """Nothing of an array of a type."""
        if not isinstance(dtype, np.dtype):  # of random keys
            dtype = np.dtype(bool)
        is_real = jnp.issubdtype(dtype, jnp.inexact)
        return cls(np.zeros((), dtype), np.array(False), not is_real)

    @property
    def is_constant(self) -> bool:
        """Whether all of it is known."""
        return bool(np.all(self.where))

    def over(self, shape: Sequence[int]) -> "Known":
        """With parts of the array's shape."""
        values, where = (np.broadcast_to(part, shape) for part in (self.values, self.where))
        return Known(values, where, self.is_finite)


def known_result(equation: Any, given: Sequence[Known]) -> Known | None:
    """What is known of an elementwise operation's result; None if it is none that is looked at."""
    name, result = equation.primitive.name, equation.outvars[0].aval
    # the operands of others, as of a concatenation, need not have one shape
    if not given or name not in _LOOKED_AT or not isinstance(result.dtype, np.dtype):
        return None
    is_truth = equation.invars[0].aval.dtype == np.bool_
    all_known = given[0].where
    for each in given[1:]:
        all_known = all_known & each.where
    finite = all(each.is_finite for each in given)
    if name in ("and", "or") and is_truth:
        absorbing = name == "or"
        # what is not known changes nothing where the other is the absorbing element
        parts = [np.where(each.where, each.values, not absorbing) for each in given]
        absorbed = [each.where & (each.values == absorbing) for each in given]
        values = parts[0] | parts[1] if absorbing else parts[0] & parts[1]
        return Known(values, all_known | absorbed[0] | absorbed[1], is_finite=True)
    if name == "not" and is_truth:
        return Known(~given[0].values, given[0].where, is_finite=True)
    if name == "convert_element_type":
        return Known(given[0].values.astype(result.dtype), given[0].where, finite)
    if name == "select_n" and len(given) == 3 and is_truth:
        asked, *cases = given
        values = np.where(asked.values, cases[1].values, cases[0].values)
        where = asked.where & np.where(asked.values, cases[1].where, cases[0].where)
        finite = all(case.is_finite for case in cases)
        return Known(values.astype(result.dtype), where, finite)
    if name == "mul":
        one, other = given
        parts = [np.where(each.where, each.values, 0) for each in given]
        zero = [each.where & (each.values == 0) for each in given]
        where = all_known | (zero[0] & other.is_finite) | (zero[1] & one.is_finite)
        return Known((parts[0] * parts[1]).astype(result.dtype), where, finite)
    if name in _COMPUTED:
        with np.errstate(all="ignore"):
            values = _COMPUTED[name](*(each.values for each in given))
        finite = finite or not jnp.issubdtype(result.dtype, jnp.inexact)
        return Known(values.astype(result.dtype), all_known, finite)
    return None


def known_reduction(name: str, given: Known, axes: tuple[int, ...]) -> Known:
    """What is known of a reduction.

    Args:
      name: of one in `REDUCED`.
      given: what is known of the array, of its shape.
      axes: along which it is reduced.
    """
    where = np.all(given.where, axis=axes)
    values = REDUCED[name](given.values, axis=axes)
    if name in ("reduce_or", "reduce_and"):
        absorbing = name == "reduce_or"
        absorbed = np.any(given.where & (given.values == absorbing), axis=axes)
        return Known(np.where(absorbed, absorbing, values), where | absorbed, is_finite=True)
    return Known(values, where, given.is_finite and name == "reduce_sum")


def known_move(equation: Any, given: Sequence[Known]) -> Known | None:
    """What is known of the result of an operation that only moves entries; None of another."""
    full = [each.over(v.aval.shape) for each, v in zip(given, equation.invars, strict=True)]
    values = moved(equation, [each.values for each in full])
    # of what has no operand all is known
    where = moved(equation, [each.where for each in full]) if full else np.array(True)
    if values is None or where is None:
        return None
    return Known(values, where, all(each.is_finite for each in given))


def moved(equation: Any, parts: Sequence[np.ndarray], lead: int = 0) -> np.ndarray | None:
    """What an operation gives that only moves entries; None if it is no such one.

    Args:
      equation: of the operation.
      parts: its operands.
      lead: so many axes more than the operation's operands are before these, and stay.
    """
    name, params = equation.primitive.name, equation.params
    result = equation.outvars[0].aval
    if name == "iota":
        along = [1] * result.ndim
        along[params["dimension"]] = -1
        counted = np.arange(result.shape[params["dimension"]], dtype=result.dtype)
        return np.broadcast_to(np.reshape(counted, along), result.shape)
    if name not in _MOVES:
        return None
    before = tuple(parts[0].shape[:lead])
    shape = (*before, *result.shape)
    if name in ("reshape", "squeeze"):
        return np.reshape(parts[0], shape)
    if name == "broadcast_in_dim":
        sizes = [1] * result.ndim
        for axis, place in enumerate(params["broadcast_dimensions"]):
            sizes[place] = parts[0].shape[lead + axis]
        return np.broadcast_to(np.reshape(parts[0], (*before, *sizes)), shape)
    if name == "transpose":
        return np.transpose(parts[0], (*range(lead), *(lead + a for a in params["permutation"])))
    if name == "concatenate":
        return np.concatenate(parts, axis=lead + params["dimension"])
    starts, limits = params["start_indices"], params["limit_indices"]
    strides = params["strides"] or (1,) * len(starts)
    taken = (slice(*each) for each in zip(starts, limits, strides, strict=True))
    return parts[0][(*[slice(None)] * lead, *taken)]


_MOVES = ("reshape", "squeeze", "broadcast_in_dim", "transpose", "concatenate", "slice")
