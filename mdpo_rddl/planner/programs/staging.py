"""Split a function into stages by what each of its operations depends on.

A rollout spends most of its time on small arrays in drawing random numbers, which do not
depend on the state. Split off, those of all steps are drawn at once.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
from jax import Array
from jax.extend.core import Literal

from mdpo_rddl.planner.programs.contraction import contract
from mdpo_rddl.planner.programs.relations import among_related
from mdpo_rddl.planner.programs.threefry import bind_written_out, is_written_out
from mdpo_rddl.planner.programs.traced import CALLS, bind, called


class _Operation(NamedTuple):
    """One primitive: its stage, where its operands are found and its results put."""

    stage: int
    primitive: Any
    params: dict[str, Any]
    inputs: tuple[Any, ...]
    outputs: tuple[int, ...]


def with_fast_random_numbers(function: Callable[..., Any]) -> Callable[..., Any]:
    """A pure function with the same results, whose random numbers cost less on a CPU."""

    def call(*arguments: Any) -> Any:
        stages = Stages(lambda given: function(*given), arguments)
        return stages.run(0, [], arguments)

    return call


class Stages:
    """A pure function of arguments known one after the other, in as many stages.

    `run(k, residuals, arguments)` does what can be done once the k-th arguments are known;
    the last stage gives the function's result. Random bits are the same as when the function
    is called as a whole, floating-point results up to the compiler's rounding.

    Attributes:
      residual_types: per stage but the last, what it hands on (`jax.ShapeDtypeStruct`).
    """

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Traces `function(*arguments)`.

        Args:
          function: a pure function.
          *arguments: one tree for each stage, of arrays or of `jax.ShapeDtypeStruct`.
        """
        closed, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
        closed = contract(among_related(closed))
        self._result_tree = jax.tree.structure(shapes)
        self._operations: list[_Operation] = []
        self._stage_of: list[int] = []
        self._types: list[Any] = []
        leaves = [jax.tree.leaves(tree) for tree in arguments]
        stages = [stage for stage, group in enumerate(leaves) for _ in group]
        inputs = [
            self._slot(stage, var.aval)
            for stage, var in zip(stages, closed.jaxpr.invars, strict=True)
        ]
        self._inputs = [
            [i for i, s in zip(inputs, stages, strict=True) if s == stage]
            for stage in range(len(arguments))
        ]
        self._constants: dict[int, Any] = {}
        self._results = self._flatten(closed, inputs)
        self._bind = bind_written_out if is_written_out() else bind
        self._last = len(arguments) - 1
        self._residuals = [self._handed_on(stage) for stage in range(self._last)]
        self.residual_types = [
            [jax.ShapeDtypeStruct(self._types[i].shape, self._types[i].dtype) for i in slots]
            for slots in self._residuals
        ]

    def passes_through(self) -> list[bool]:
        """Per leaf of the result, whether it is one of the arguments as it is."""
        arguments = {slot for group in self._inputs for slot in group}
        return [not isinstance(r, Literal) and r in arguments for r in self._results]

    def run(self, stage: int, residuals: Sequence[Sequence[Array]], arguments: Any) -> Any:
        """One stage.

        Args:
          stage: from 0.
          residuals: what the stages before it gave, in order.
          arguments: this stage's.

        Returns:
          The residuals to hand on; after the last stage the function's result.
        """
        values = dict(self._constants)
        for slots, handed_on in zip(self._residuals, residuals, strict=False):
            values.update(zip(slots, handed_on, strict=True))
        values.update(zip(self._inputs[stage], jax.tree.leaves(arguments), strict=True))

        def read(source: Any) -> Any:
            return source.val if isinstance(source, Literal) else values[source]

        for operation in self._operations:
            if operation.stage != stage:
                continue
            operands = [read(source) for source in operation.inputs]
            results = self._bind(operation.primitive, operation.params, operands)
            values.update(zip(operation.outputs, results, strict=True))
        if stage < self._last:
            return [values[slot] for slot in self._residuals[stage]]
        return jax.tree.unflatten(self._result_tree, [read(source) for source in self._results])

    def _slot(self, stage: int, aval: Any) -> int:
        self._stage_of.append(stage)
        self._types.append(aval)
        return len(self._stage_of) - 1

    def _flatten(self, closed: Any, inputs: Sequence[Any]) -> list[Any]:
        """Appends the operations of a jaxpr, those of the functions it calls among them."""
        jaxpr = closed.jaxpr
        slots: dict[Any, Any] = dict(zip(jaxpr.invars, inputs, strict=True))
        for var, value in zip(jaxpr.constvars, closed.consts, strict=True):
            slots[var] = self._slot(0, var.aval)
            self._constants[slots[var]] = value

        def find(atom: Any) -> Any:
            return atom if isinstance(atom, Literal) else slots[atom]

        for equation in jaxpr.eqns:
            sources = tuple(find(atom) for atom in equation.invars)
            if equation.primitive.name in CALLS:
                outputs = self._flatten(called(equation), sources)
            else:
                stages = [self._stage_of[s] for s in sources if not isinstance(s, Literal)]
                # what has effects stays where all is known
                stage = len(self._inputs) - 1 if equation.effects else max(stages, default=0)
                outputs = [self._slot(stage, var.aval) for var in equation.outvars]
                self._operations.append(
                    _Operation(stage, equation.primitive, equation.params, sources, tuple(outputs))
                )
            slots.update(zip(equation.outvars, outputs, strict=True))
        return [find(atom) for atom in jaxpr.outvars]

    def _handed_on(self, stage: int) -> list[int]:
        used = {s for s in self._results if not isinstance(s, Literal)}
        for operation in self._operations:
            if operation.stage > stage:
                used |= {s for s in operation.inputs if not isinstance(s, Literal)}
        return sorted(s for s in used - set(self._constants) if self._stage_of[s] == stage)
