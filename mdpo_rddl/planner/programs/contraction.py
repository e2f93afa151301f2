"""Sums of products over pairs of objects, as matrix products.

RDDL writes what happens between objects as a sum over all pairs, `sum_{?j} [A(?i, ?j) * x(?j)]`,
which is compiled into two matrices that are broadcast, multiplied and summed. Here whatever is
constant along an axis is computed without that axis, and what is summed of it by `einsum`.
Truth values are numbers 0 and 1 there: "exists" is a sum above 0, "for all" one that is complete.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, core, lax
from jax.extend.core import ClosedJaxpr

from mdpo_rddl.planner.programs.traced import ELEMENTWISE, bind, has_equation, rewritten

# smaller arrays are computed as they are written
_WORTH_ELEMENTS = 4096
# of truth values
_WORTH_TRUTHS = 1024
# so many are counted exactly in single precision, in which a half less is a number of its own
_MOST_COUNTED = 2**23
_MAX_TERMS = 4
_LETTERS = "abcdefghijklmnopqrstuvwxyz"


@dataclass(frozen=True)
class _View:
    """An array that is constant along all axes but some.

    Attributes:
      base: the values.
      axes: for each axis of `base`, the axis of the whole that it is.
    """

    base: Any
    axes: tuple[int, ...]

    def aligned(self, axes: Sequence[int], shape: Sequence[int]) -> Array:
        """The values over some axes in order, which include all of its own."""
        order = np.argsort(self.axes).tolist()
        base = jnp.transpose(self.base, order)
        own = set(self.axes)
        sizes = [shape[axis] if axis in own else 1 for axis in axes]
        return jnp.broadcast_to(jnp.reshape(base, sizes), [shape[axis] for axis in axes])


_Terms = tuple[tuple[float, tuple[_View, ...]], ...]


@dataclass(frozen=True)
class _Factored:
    """A large array, known as a sum of products of views; written out only if it must be.

    Attributes:
      shape: of the whole.
      terms: the sum; each term is a sign and its factors.
      recipe: how the program computes the whole.
    """

    shape: tuple[int, ...]
    terms: _Terms
    recipe: Callable[[], Array]

    @property
    def view(self) -> _View | None:
        """The only factor, if it is one."""
        (sign, factors), *others = self.terms
        return factors[0] if sign > 0 and len(factors) == 1 and not others else None

    @cached_property
    def whole(self) -> Array:
        """The array, written out."""
        return self.recipe()


def contract(closed: ClosedJaxpr) -> ClosedJaxpr:
    """A program with the same results, in which large sums of products are contracted.

    Results agree up to the order of floating-point operations. A program without large
    broadcasts is returned as it is.
    """
    if not has_equation(closed.jaxpr, _is_large_broadcast):
        return closed
    return rewritten(closed, _apply, _whole)


def _is_large_broadcast(equation: Any) -> bool:
    if equation.primitive.name != "broadcast_in_dim":
        return False
    (operand, *_), (result,) = equation.invars, equation.outvars
    return operand.aval.size not in (1, result.aval.size) and _is_large(result.aval)


def _apply(equation: Any, operands: list[Any]) -> list[Any]:
    name, params = equation.primitive.name, equation.params

    def plain() -> list[Any]:
        return bind(equation.primitive, params, [_whole(operand) for operand in operands])

    result = equation.outvars[0].aval
    if name == "broadcast_in_dim" and _is_large(result):
        return [_broadcast(operands[0], params, lambda: plain()[0])]
    if not any(isinstance(operand, _Factored) for operand in operands):
        return plain()
    shape = result.shape
    if name == "transpose":
        return [_transpose(operands[0], params["permutation"], shape, lambda: plain()[0])]
    if name == "reduce_sum" and jnp.issubdtype(result.dtype, jnp.floating):
        return [_sum(operands[0], params["axes"], shape, result.dtype)]
    is_counting = jnp.issubdtype(result.dtype, jnp.signedinteger)
    if name == "reduce_sum" and is_counting and _counts(operands[0], params["axes"]):
        return [_sum(operands[0], params["axes"], shape, jnp.float32).astype(result.dtype)]
    if name in ("reduce_or", "reduce_and") and _is_truth(result):
        return [_quantified(name, operands[0], params["axes"], shape)]
    if name in ELEMENTWISE:
        return [_elementwise(equation, operands, shape, lambda: plain()[0])]
    return plain()


def _is_truth(value: Any) -> bool:
    return bool(value.dtype == np.bool_)


def _is_large(value: Any) -> bool:
    worth = _WORTH_TRUTHS if _is_truth(value) else _WORTH_ELEMENTS
    return value.ndim > 1 and value.size >= worth


def _whole(value: Any) -> Any:
    return value.whole if isinstance(value, _Factored) else value


def _view_of(value: Any) -> _View | None:
    if isinstance(value, _Factored):
        return value.view
    return _View(value, tuple(range(np.ndim(value))))


def _terms_of(value: Any, shape: Sequence[int]) -> _Terms:
    if isinstance(value, _Factored):
        return value.terms
    axes = tuple(range(len(shape))) if np.ndim(value) else ()
    return ((1.0, (_View(value, axes),)),)


def _product(left: tuple[_View, ...], right: tuple[_View, ...]) -> tuple[_View, ...]:
    """The factors of both, one for each set of axes; numbers go into the smallest."""
    # two matrices that no step changes become one, ahead of the steps; einsum could as well
    # multiply one by the step's vector and then sum over both
    merged: dict[frozenset[int], _View] = {}
    for factor in (f for f in left + right if f.axes):
        same = merged.get(frozenset(factor.axes))
        if same is not None:
            order = [factor.axes.index(axis) for axis in same.axes]
            factor = _View(same.base * jnp.transpose(factor.base, order), same.axes)
        merged[frozenset(factor.axes)] = factor
    factors = sorted(merged.values(), key=lambda f: f.base.size)
    numbers = [f.base for f in left + right if not f.axes]
    for number in numbers:
        if not _is_one(number):  # JaxPlan multiplies by 1 to make a number
            smallest, *others = factors or [_View(1.0, ())]
            factors = [_View(smallest.base * number, smallest.axes), *others]
    return tuple(factors) or (_View(1.0, ()),)


def _broadcast(operand: Any, params: dict[str, Any], recipe: Callable[[], Array]) -> Any:
    view, shape = _view_of(operand), params["shape"]
    if view is None:
        return recipe()
    axes = [params["broadcast_dimensions"][axis] for axis in view.axes]
    kept = [i for i, axis in enumerate(axes) if view.base.shape[i] == shape[axis]]
    base = jnp.squeeze(view.base, tuple(i for i in range(len(axes)) if i not in kept))
    new = _View(base, tuple(axes[i] for i in kept))
    return _Factored(tuple(shape), ((1.0, (new,)),), recipe)


def _transpose(
    operand: _Factored,
    permutation: Sequence[int],
    shape: tuple[int, ...],
    recipe: Callable[[], Array],
) -> _Factored:
    place = {axis: new for new, axis in enumerate(permutation)}
    terms = tuple(
        (sign, tuple(_View(f.base, tuple(place[axis] for axis in f.axes)) for f in factors))
        for sign, factors in operand.terms
    )
    return _Factored(shape, terms, recipe)


def _elementwise(
    equation: Any, operands: list[Any], shape: tuple[int, ...], recipe: Callable[[], Array]
) -> Any:
    name = equation.primitive.name
    views = [_view_of(operand) for operand in operands]
    axes = sorted({axis for view in views if view is not None for axis in view.axes})
    if None not in views and len(axes) < len(shape):
        # constant along an axis: computed without it; a number stays one where that is allowed
        fills = name == "select_n"
        aligned = [
            v.aligned(axes, shape) if v.axes or fills else v.base for v in views if v is not None
        ]
        base = bind(equation.primitive, equation.params, aligned)[0]
        return _Factored(shape, ((1.0, (_View(base, tuple(axes)),)),), recipe)
    given = [_terms_of(operand, shape) for operand in operands]
    terms = _truths(equation, given) if _is_truth(equation.invars[0].aval) else None
    if name == "add":
        terms = _plus(*given)
    elif name == "sub":
        terms = _plus(given[0], _negative(given[1]))
    elif name == "mul" and _may_be_multiplied_out(*given):
        terms = _times(*given)
    elif name == "neg":
        terms = _negative(given[0])
    if terms is None or len(terms) > _MAX_TERMS or max(len(f) for _, f in terms) > _MAX_TERMS:
        return recipe()
    return _Factored(shape, terms, recipe)


def _truths(equation: Any, given: Sequence[_Terms]) -> _Terms | None:
    """An operation on truth values as one on numbers; None if it is none of those known."""
    name, result = equation.primitive.name, equation.outvars[0].aval
    if name == "and":
        return _times(*given)
    if name == "or":
        return _plus(_plus(*given), _negative(_times(*given)))
    if name == "not":
        return _plus(((1.0, (_View(True, ()),)),), _negative(given[0]))
    if name == "convert_element_type" and jnp.issubdtype(result.dtype, jnp.number):
        return given[0]
    return None


def _may_be_multiplied_out(left: _Terms, right: _Terms) -> bool:
    """Whether a product of two sums is as exact as a sum of products.

    Of two differences it is not: where x and y are close, x^2 - 2 x y + y^2 has an error of the
    size of x^2, (x - y)^2 one of the size of (x - y)^2. The same for 1 less a truth value, times a
    number. A difference times a number stays linear in x and y, whose own rounding is as large.
    """
    if len(left) == len(right) == 1:
        return True
    if _are_counted(left) or _are_counted(right):
        return _are_counted(left) and _are_counted(right)
    return 1 in (len(left), len(right))


def _are_counted(terms: _Terms) -> bool:
    """Whether all factors are truth values or ones: sums of their products are not rounded."""

    def is_counted(base: Any) -> bool:
        return _is_one(base) or (hasattr(base, "dtype") and _is_truth(base))

    return all(is_counted(factor.base) for _, factors in terms for factor in factors)


def _is_one(value: Any) -> bool:
    # of JAX's own constants none is compared while a program is traced
    is_known = np.ndim(value) == 0 and not isinstance(value, core.Tracer)
    return is_known and bool(np.asarray(value) == 1)


def _counts(operand: _Factored, axes: Sequence[int]) -> bool:
    """Whether a sum counts truth values, so few that single precision has their number."""
    most = math.prod(operand.shape[axis] for axis in axes) * len(operand.terms)
    return most <= _MOST_COUNTED and _are_counted(operand.terms)


def _plus(left: _Terms, right: _Terms) -> _Terms:
    return left + right


def _negative(terms: _Terms) -> _Terms:
    return tuple((-sign, factors) for sign, factors in terms)


def _times(left: _Terms, right: _Terms) -> _Terms:
    return tuple((s * t, _product(f, g)) for s, f in left for t, g in right)


def _quantified(
    name: str, operand: _Factored, axes: Sequence[int], shape: tuple[int, ...]
) -> Array:
    """Whether any of the values along some axes is true, or all are."""
    counted = int(np.prod([operand.shape[axis] for axis in axes]))
    if counted > _MOST_COUNTED:
        reduce = jnp.any if name == "reduce_or" else jnp.all
        return reduce(operand.whole, axis=tuple(axes))
    true = _sum(operand, axes, shape, jnp.float32)
    return true > (0.5 if name == "reduce_or" else counted - 0.5)


def _sum(operand: _Factored, axes: Sequence[int], shape: tuple[int, ...], dtype: Any) -> Array:
    left = [axis for axis in range(len(operand.shape)) if axis not in axes]
    total = jnp.zeros((), dtype)
    for sign, factors in operand.terms:
        covered = {axis for factor in factors for axis in factor.axes}
        letters = ["".join(_LETTERS[axis] for axis in factor.axes) for factor in factors]
        result = [axis for axis in left if axis in covered]
        subscripts = ",".join(letters) + "->" + "".join(_LETTERS[axis] for axis in result)
        bases = [jnp.asarray(factor.base, dtype) for factor in factors]
        value = jnp.einsum(subscripts, *bases, precision=lax.Precision.HIGHEST)
        repeats = np.prod([operand.shape[axis] for axis in axes if axis not in covered])
        sizes = [operand.shape[axis] if axis in covered else 1 for axis in left]
        value = jnp.reshape(sign * float(repeats) * value, sizes)
        total = total + value
    return jnp.broadcast_to(total, shape)
