"""How likely each bool of the next state is, where the exact model states that."""

from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.model.expressions import compiled_expression
from mdpo_rddl.problem.chance import draws

Fluents = Mapping[str, Any]
_Chance = Callable[[Fluents], Array]


class Expectation:
    """The probabilities of the next state's bools, components being independent given the step.

    Read are Bernoulli and certain laws, choices between them by what is certain, and what is made
    of these by "not", "and" and "or", whose draws are independent.

    Attributes:
      names: the state fluents whose laws are read.
      is_whole: whether nothing else is drawn in a step.
    """

    def __init__(self, compiled: Any) -> None:
        """Reads the laws.

        Args:
          compiled: the exact model as JaxPlan compiles it.
        """
        rddl = compiled.rddl
        self._nonfluents = compiled.split_fluent_nonfluent(compiled.init_values)[1]
        self._shapes = {n: np.shape(compiled.init_values[n]) for n in rddl.state_fluents}
        self._chances: dict[str, _Chance] = {}
        for name in self._shapes:
            expression = rddl.cpfs[rddl.next_state[name]][1]
            if rddl.variable_ranges[name] != "bool" or not draws(expression):
                continue
            chance = _read(lambda part: self._compiled(compiled, part), expression)
            if chance is not None:
                self._chances[name] = chance
        self.names = list(self._chances)
        read = {rddl.next_state[name] for name in self.names}
        others = [cpf for name, (_, cpf) in rddl.cpfs.items() if name not in read]
        self.is_whole = not draws([*others, rddl.reward])

    def __call__(self, fluents: Fluents) -> dict[str, Array]:
        """Per fluent of `names` its probability of true after the step [*shape].

        Args:
          fluents: of one step: the state before it, the actions, and all that is computed or drawn
            on the way to the next state.
        """
        found = {name: chance(fluents) for name, chance in self._chances.items()}
        return {n: jnp.broadcast_to(each, self._shapes[n]) for n, each in found.items()}

    def _compiled(self, compiled: Any, part: Any) -> _Chance:
        value = compiled_expression(compiled, part)
        return lambda fluents: jnp.asarray(value(fluents, self._nonfluents), compiled.REAL)


def _read(compile_one: Callable[[Any], _Chance], expression: Any) -> _Chance | None:
    """The probability of an expression; None where it is of another kind."""
    if not draws(expression):
        return compile_one(expression)
    kind, arguments = expression.etype[1], expression.args
    if kind == "Bernoulli" and not draws(arguments):
        chance = compile_one(arguments[0])
        return lambda fluents: jnp.clip(chance(fluents), 0.0, 1.0)
    if kind == "KronDelta":
        return _read(compile_one, arguments[0])
    if kind == "if" and not draws(arguments[0]):
        condition = compile_one(arguments[0])
        first, second = (_read(compile_one, part) for part in arguments[1:])
        if first is None or second is None:
            return None
        return lambda given: jnp.where(condition(given) > 0.5, first(given), second(given))
    if kind not in ("~", "^", "|") or (kind == "~" and len(arguments) != 1):
        return None
    parts = [_read(compile_one, part) for part in arguments]
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    if kind == "~":
        return lambda fluents: 1.0 - known[0](fluents)
    if kind == "^":
        return lambda fluents: reduce(jnp.multiply, [part(fluents) for part in known])
    return lambda fluents: 1.0 - reduce(jnp.multiply, [1.0 - part(fluents) for part in known])
