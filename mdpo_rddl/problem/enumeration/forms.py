"""What lifted expressions are made of, each worked out once: pyRDDLGym does each time."""

from typing import Any, NamedTuple

_WHOLE: dict[str, set[str] | None] = {
    "relational": None,
    "boolean": None,
    "aggregation": {"forall", "exists", "argmin", "argmax"},
    "func": {"sgn", "round", "floor", "ceil", "div", "mod"},
    "randomvar": {"Bernoulli", "Poisson", "Binomial", "NegativeBinomial", "Geometric"}
    | {"Discrete", "UnnormDiscrete", "Discrete(p)", "UnnormDiscrete(p)"},
    "randomvector": {"Multinomial"},
}
"""Per kind the names of what is whole whatever its arguments are, None for all."""
_KEEPING = {
    "arithmetic": {"+", "-", "*"},
    "aggregation": {"sum", "prod", "minimum", "maximum"},
    "func": {"abs", "min", "max", "fmod", "pow"},
    "control": {"if", "switch"},
    "randomvar": {"KronDelta", "DiracDelta"},
}
"""Per kind the names of what is whole where its arguments are."""


def is_whole(rddl: Any, expression: Any) -> bool:
    """Whether the environment computes an expression as a whole number, a bool or an object.

    Args:
      rddl: pyRDDLGym's model.
      expression: of its own.
    """
    (kind, name), arguments = expression.etype, expression.args
    if kind == "constant":
        return not isinstance(arguments, float)
    if kind == "pvar":
        return bool(rddl.variable_ranges.get(arguments[0]) != "real")
    whole = _WHOLE.get(kind, set())
    if whole is None or name in whole:
        return True
    if name not in _KEEPING.get(kind, ()):
        return False
    if kind == "aggregation":
        arguments = arguments[-1:]
    elif kind == "control":
        arguments = arguments[1:]
        if name == "switch":
            arguments = [each if case == "default" else each[1] for case, each in arguments]
    return all(is_whole(rddl, each) for each in arguments)


class Form(NamedTuple):
    """An expression's kind, name and arguments, of a conjunction those first that may decide."""

    kind: str
    name: str
    arguments: Any


class Forms:
    """The forms of a model's expressions."""

    def __init__(self, rddl: Any) -> None:
        """Knows none yet.

        Args:
          rddl: pyRDDLGym's lifted model.
        """
        self._rddl = rddl
        self._known: dict[int, Form] = {}
        self._has_draws: dict[int, bool] = {}
        self._kept: list[Any] = []  # so that no identity is used again

    def __call__(self, expression: Any) -> Form:
        """The form of an expression."""
        found = self._known.get(id(expression))
        if found is None:
            (kind, name), arguments = expression.etype, expression.args
            if kind == "boolean" and name in ("^", "&", "|"):
                arguments = sorted(arguments, key=self._rank)
            found = self._known[id(expression)] = Form(kind, name, arguments)
            self._kept.append(expression)
        return found

    def is_random(self, expression: Any) -> bool:
        """Whether a draw stands in the expression itself."""
        if isinstance(expression, (tuple, list)):
            return any(map(self.is_random, expression))
        if not hasattr(expression, "etype"):
            return False
        known = self._has_draws.get(id(expression))
        if known is None:
            is_draw = expression.etype[0] in ("randomvar", "randomvector")
            known = is_draw or self.is_random(expression.args)
            self._has_draws[id(expression)] = known
            self._kept.append(expression)
        return known

    def _rank(self, expression: Any) -> int:
        """Non-fluents first: they are the ones that decide."""
        kind, _, arguments = self(expression)
        if kind == "pvar":
            return 0 if self._rddl.variable_types.get(arguments[0]) == "non-fluent" else 1
        return 0 if kind in ("constant", "relational") else 2
