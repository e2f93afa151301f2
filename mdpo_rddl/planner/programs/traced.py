"""Programs as JAX traces them: read, and run again with other operations."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax.extend.core import ClosedJaxpr, Literal

CALLS = ("jit", "pjit", "closed_call", "core_call")
ELEMENTWISE = frozenset(
    [
        "abs",
        "add",
        "and",
        "ceil",
        "clamp",
        "convert_element_type",
        "copy",
        "cos",
        "div",
        "eq",
        "exp",
        "expm1",
        "floor",
        "ge",
        "gt",
        "integer_pow",
        "is_finite",
        "le",
        "log",
        "log1p",
        "logistic",
        "lt",
        "max",
        "min",
        "mul",
        "ne",
        "neg",
        "not",
        "or",
        "pow",
        "rem",
        "round",
        "select_n",
        "sign",
        "sin",
        "sqrt",
        "square",
        "stop_gradient",
        "sub",
        "tan",
        "tanh",
        "xor",
    ]
)
"""Operations whose entries depend on the same entries of their operands."""


def called(equation: Any) -> ClosedJaxpr:
    """The program that a call runs."""
    return equation.params.get("jaxpr", equation.params.get("call_jaxpr"))


def bind(primitive: Any, params: dict[str, Any], operands: Sequence[Any]) -> list[Any]:
    """Applies a primitive, and gives its results as a list."""
    bound = primitive.get_bind_params(params)
    if isinstance(bound, tuple):  # before jax 0.9 the functions came apart
        functions, bound = bound
        operands = [*functions, *operands]
    results = primitive.bind(*operands, **bound)
    return list(results) if primitive.multiple_results else [results]


def has_equation(jaxpr: Any, is_meant: Callable[[Any], bool]) -> bool:
    """Whether a program has such an operation, in its calls or outside of them."""
    return any(
        has_equation(called(equation).jaxpr, is_meant)
        if equation.primitive.name in CALLS
        else is_meant(equation)
        for equation in jaxpr.eqns
    )


def rewritten(
    closed: ClosedJaxpr,
    apply: Callable[[Any, list[Any]], list[Any]],
    whole: Callable[[Any], Any],
) -> ClosedJaxpr:
    """A program, each operation as `apply` does it, as one without calls.

    Args:
      closed: the program.
      apply: as of `replay`.
      whole: makes an array of a result of `apply`.
    """
    inputs = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in closed.jaxpr.invars]
    return jax.make_jaxpr(lambda *values: [whole(v) for v in replay(closed, values, apply)])(
        *inputs
    )


def replay(
    closed: ClosedJaxpr, inputs: Sequence[Any], apply: Callable[[Any, list[Any]], list[Any]]
) -> list[Any]:
    """Runs a program, that of its calls included, each operation as `apply` does it.

    Args:
      closed: the program.
      inputs: its arguments, of any kind that `apply` takes.
      apply: gives the results of an equation on operands.
    """
    jaxpr = closed.jaxpr
    values: dict[Any, Any] = dict(zip(jaxpr.constvars, closed.consts, strict=True))
    values.update(zip(jaxpr.invars, inputs, strict=True))

    def read(atom: Any) -> Any:
        return atom.val if isinstance(atom, Literal) else values[atom]

    for equation in jaxpr.eqns:
        operands = [read(atom) for atom in equation.invars]
        if equation.primitive.name in CALLS:
            results = replay(called(equation), operands, apply)
        else:
            results = apply(equation, operands)
        values.update(zip(equation.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]
