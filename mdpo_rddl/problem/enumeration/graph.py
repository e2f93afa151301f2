"""Ground expressions as a graph in which no expression stands twice.

Nodes are numbered in the order of their making, so that arguments come before what uses them.
"""

import math
from collections.abc import Hashable, Iterable, Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.enumeration.operators import BOOL_OPERATORS, OPERATORS, PARTIAL

_PLAIN = (bool, int, float)


class Kind:
    """What the value of a node depends on: bits of a mask, plain ints, which are many."""

    CONSTANT = 0
    STATE = 1
    ACTION = 2
    DRAWN = 4


class Graph:
    """A growing graph of expressions; equal expressions have one number.

    Attributes:
      operators: of each node its operator, "constant" or "leaf".
      arguments: of each node the numbers of its arguments.
      values: of a constant its value, of a leaf its name, else None.
      is_bool: whether the value of each node is a bool.
      depends: of each node, what it depends on.
    """

    def __init__(self) -> None:
        """Starts with no node."""
        self.operators: list[str] = []
        self.arguments: list[tuple[int, ...]] = []
        self.values: list[Any] = []
        self.is_bool: list[bool] = []
        self.depends: list[int] = []
        # whether infinity or no number may come out
        self._may_be_undefined: list[bool] = []
        self._numbers: dict[Hashable, int] = {}
        self.true, self.false = self.constant(True), self.constant(False)
        self.zero, self.one = self.constant(0), self.constant(1)

    def constant(self, value: Any) -> int:
        """The node of a number or a bool."""
        if type(value) not in _PLAIN:
            value = np.asarray(value).item()
        key = (type(value), value)
        return self._number(key, "constant", (), value, isinstance(value, bool), Kind.CONSTANT)

    def leaf(self, kind: int, name: Hashable, is_bool: bool) -> int:
        """The node of a ground variable."""
        return self._number((kind, name), "leaf", (), name, is_bool, kind)

    def is_constant(self, node: int) -> bool:
        """Whether the node is a number or a bool."""
        return self.operators[node] == "constant"

    def make(self, operator: str, *arguments: int) -> int:
        """The node of an operator applied to nodes, simplified."""
        operators = self.operators
        if all(operators[each] == "constant" for each in arguments):
            with np.errstate(all="ignore"):
                value = OPERATORS[operator](*(self.values[each] for each in arguments))
            return self.constant(value)
        if operator in ("and", "or"):
            return self._junction(operator, arguments)
        if operator == "if":
            return self._choice(*arguments)
        if operator in ("+", "*"):
            return self._series(operator, arguments)
        if operator == "not" and self.operators[arguments[0]] == "not":
            return self.arguments[arguments[0]][0]
        if len(arguments) == 1 and operator in ("minimum", "maximum", "min", "max"):
            return arguments[0]
        return self._node(operator, arguments, operator in BOOL_OPERATORS)

    def weighted(self, value: int, probability: int) -> int:
        """A value times its probability; 0 where that is 0, even of an undefined value."""
        product = self.make("*", value, probability)
        if self.is_constant(probability) or not self._may_be_undefined[value]:
            return product
        return self.make("if", self.make(">", probability, self.zero), product, self.zero)

    def substitute(self, nodes: Iterable[int], values: Mapping[int, int]) -> list[int]:
        """The nodes with leaves replaced by other nodes."""
        nodes = list(nodes)
        new = dict(values)
        for node in self.needed(nodes, self.kinds(values)):
            if node not in new:
                new[node] = self.remade(node, new)
        return [new.get(node, node) for node in nodes]

    def kinds(self, leaves: Iterable[int]) -> int:
        """All that is among leaves."""
        mask = Kind.CONSTANT
        for leaf in leaves:
            mask |= self.depends[leaf]
        return mask

    def remade(self, node: int, new: Mapping[int, int]) -> int:
        """The node with its arguments replaced, of those that are."""
        old = self.arguments[node]
        changed = tuple(new.get(each, each) for each in old)
        return node if changed == old else self.make(self.operators[node], *changed)

    def needed(self, nodes: Iterable[int], mask: int | None = None) -> list[int]:
        """The nodes and all below them, arguments first; with a mask only what depends on it."""
        found: set[int] = set()
        waiting = list(nodes)
        while waiting:
            node = waiting.pop()
            if node in found or (mask is not None and not self.depends[node] & mask):
                continue
            found.add(node)
            waiting.extend(self.arguments[node])
        return sorted(found)

    def _number(
        self, key: Any, operator: str, arguments: tuple[int, ...], value: Any, *rest: Any
    ) -> int:
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self.operators)
            self.operators.append(operator)
            self.arguments.append(arguments)
            self.values.append(value)
            is_bool, depends = rest
            self.is_bool.append(is_bool)
            self.depends.append(depends)
            self._may_be_undefined.append(self._is_partial(operator, arguments, value))
        return number

    def _is_partial(self, operator: str, arguments: tuple[int, ...], value: Any) -> bool:
        if operator == "constant":
            return not math.isfinite(value)
        if operator == "/" and self.is_constant(arguments[1]) and self.values[arguments[1]] != 0:
            return self._may_be_undefined[arguments[0]]
        return operator in PARTIAL or any(self._may_be_undefined[each] for each in arguments)

    def _node(self, operator: str, arguments: tuple[int, ...], is_bool: bool) -> int:
        depends = Kind.CONSTANT
        for each in arguments:
            depends |= self.depends[each]
        return self._number((operator, arguments), operator, arguments, None, is_bool, depends)

    def _junction(self, operator: str, arguments: tuple[int, ...]) -> int:
        """A conjunction or disjunction: constants and repetitions go."""
        ends = self.false if operator == "and" else self.true
        neutral = self.true if operator == "and" else self.false
        if ends in arguments:
            return ends
        left = sorted(set(arguments) - {neutral})
        return left[0] if len(left) == 1 else self._node(operator, tuple(left), True)

    def _choice(self, condition: int, yes: int, no: int) -> int:
        if self.is_constant(condition):
            return yes if self.values[condition] else no
        if yes == no:
            return yes
        is_bool = self.is_bool[yes] and self.is_bool[no]
        if is_bool:
            if yes == self.true:
                return self.make("or", condition, no)
            if yes == self.false:
                return self.make("and", self.make("not", condition), no)
            if no == self.true:
                return self.make("or", self.make("not", condition), yes)
            if no == self.false:
                return self.make("and", condition, yes)
        return self._node("if", (condition, yes, no), is_bool)

    def _series(self, operator: str, arguments: tuple[int, ...]) -> int:
        """A sum or product: its constants become one, which goes where it changes nothing."""
        neutral = 0 if operator == "+" else 1
        constants = [self.values[each] for each in arguments if self.is_constant(each)]
        left = sorted(each for each in arguments if not self.is_constant(each))
        total = OPERATORS[operator](neutral, *constants)
        if operator == "*" and total == 0:
            return self.zero
        if total != neutral:
            left.append(self.constant(total))
        return left[0] if len(left) == 1 else self._node(operator, tuple(left), False)
