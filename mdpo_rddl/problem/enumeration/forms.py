"""What lifted expressions are made of, each worked out once: pyRDDLGym does each time."""

from typing import Any, NamedTuple


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
