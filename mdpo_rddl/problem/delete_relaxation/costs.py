"""What it costs to make an expression take a value, as a circuit over the costs of literals.

Costs add up over what must hold together, as in h_add (Bonet and Geffner, "Planning as heuristic
search", 2001). An event of probability p costs -ln p here, so that what a chain of events costs
stands for the product of their probabilities.

What is not understood costs nothing: the relaxation only ever hopes too much.
"""

import math
from collections.abc import Callable, Iterable, Mapping

from mdpo_rddl.problem.delete_relaxation.circuit import Circuit, Literal
from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.laws import Law
from mdpo_rddl.problem.enumeration.limits import NotEnumerableError
from mdpo_rddl.problem.enumeration.model import OpenModel

_TURNED = {"<": ">", "<=": ">=", ">": ">", ">=": ">="}
_NEGATED = {">": ">=", ">=": ">"}


def chance_cost(probability: float) -> float:
    """What an event of this probability costs."""
    return -math.log(min(1.0, probability)) if probability > 0.0 else math.inf


class Costs:
    """Costs of nodes of a ground model that read no action."""

    def __init__(
        self, model: OpenModel, circuit: Circuit, drawn: Mapping[int, Law] | None = None
    ) -> None:
        """Costs nothing yet.

        Args:
          model: whose nodes they are.
          circuit: that grows.
          drawn: laws of what is drawn, which read no action; the model's if None.
        """
        self._graph, self._circuit = model.graph, circuit
        self._drawn = model.rules.drawn if drawn is None else drawn
        self._ranges, self._objects = model.ranges, model.objects
        self._variables = {ground: number for number, ground in enumerate(model.variables)}
        self._known: dict[tuple[Callable[..., int], int, object], int] = {}

    def values(self, variable: int) -> range:
        """Numbers of a variable's values; none of an int, whose values are not looked at."""
        kind = self._ranges[variable]
        return range(2) if kind == "bool" else range(len(self._objects.get(kind, ())))

    def becomes(self, law: Law, value: int, is_bool: bool) -> int:
        """The node of the cost of a next value: by its law, which reads no action."""
        if is_bool:
            (only,) = law
            return self.happens(only.value) if value else self.fails(only.value)
        return self._drawn_as(law, lambda node: self.equals(node, value))

    def truth(self, node: int, wanted: bool) -> int:
        """The node of the cost of a bool's being true, or false."""
        return self._once(self._truth, node, wanted)

    def happens(self, node: int) -> int:
        """The node of the cost of an event, given its probability's node, or what decides it."""
        return self._once(self._happens, node)

    def fails(self, node: int) -> int:
        """The same of its not happening."""
        return self._once(self._fails, node)

    def positive(self, node: int) -> int:
        """The node of the cost of a number's being above 0, or a bool's being true."""
        return self._once(self._positive, node)

    def equals(self, node: int, value: object) -> int:
        """The node of the cost of an object's, a number's or a bool's being equal to a constant."""
        return self._once(self._equals, node, value)

    def _once(self, function: Callable[..., int], node: int, *wanted: object) -> int:
        key = (function, node, wanted)
        if key not in self._known:
            try:
                self._known[key] = function(node, *wanted)
            except RecursionError:
                raise NotEnumerableError("an expression is too deep") from None
        return self._known[key]

    def _truth(self, node: int, wanted: bool) -> int:
        graph, circuit = self._graph, self._circuit
        operator, arguments = graph.operators[node], graph.arguments[node]
        if operator == "constant":
            return circuit.free if bool(graph.values[node]) == wanted else circuit.impossible
        if not graph.is_bool[node]:
            return self.happens(node) if wanted else circuit.free
        if operator == "leaf":
            return self._leaf(node, int(wanted))
        if operator == "not":
            return self.truth(arguments[0], not wanted)
        if operator in ("and", "or"):
            parts = [self.truth(each, wanted) for each in arguments]
            return circuit.total(parts) if (operator == "and") == wanted else circuit.least(parts)
        if operator == "if":
            return self._chosen(arguments, lambda each: self.truth(each, wanted))
        if operator in ("iff", "xor"):
            return self._both(arguments, are_equal=(operator == "iff") == wanted)
        if operator in ("==", "~="):
            return self._compared(arguments, are_equal=(operator == "==") == wanted)
        return self._ordered(operator, arguments, wanted)

    def _both(self, arguments: tuple[int, ...], are_equal: bool) -> int:
        one, other = arguments
        return self._circuit.least(
            self._circuit.total(
                [self.truth(one, value), self.truth(other, value if are_equal else not value)]
            )
            for value in (False, True)
        )

    def _compared(self, arguments: tuple[int, ...], are_equal: bool) -> int:
        graph = self._graph
        one, other = sorted(arguments, key=graph.is_constant)
        if not graph.is_constant(other):
            return self._circuit.free
        value = graph.values[other]
        return self.equals(one, value) if are_equal else self._differs(one, value)

    def _ordered(self, operator: str, arguments: tuple[int, ...], wanted: bool) -> int:
        """Of a comparison: whether a number exceeds a constant that is no less than 0."""
        greater, less = arguments if operator in (">", ">=") else reversed(arguments)
        operator = _TURNED[operator]
        if not wanted:
            greater, less, operator = less, greater, _NEGATED[operator]
        graph, free = self._graph, self._circuit.free
        if not graph.is_constant(less):
            return free
        bound = graph.values[less]
        is_any = bound < 0 or (bound == 0 and operator == ">=")
        return free if is_any else self.positive(greater)

    def _leaf(self, node: int, value: int) -> int:
        graph = self._graph
        if graph.depends[node] == Kind.STATE:
            return self._circuit.literal(Literal(self._variables[graph.values[node]], value))
        law = self._drawn[node]
        if graph.is_bool[node]:
            return self._drawn_as(law, lambda each: self.truth(each, bool(value)))
        return self._drawn_as(law, lambda each: self.equals(each, value))

    def _drawn_as(self, law: Law, cost: Callable[[int], int]) -> int:
        """The cheapest branch of a law, given what its value costs."""
        total = self._circuit.total
        if len(law) == 1:
            return cost(law[0].value)
        return self._circuit.least(
            total([cost(each.value), self.happens(each.probability)]) for each in law
        )

    def _chosen(self, arguments: Iterable[int], cost: Callable[[int], int]) -> int:
        """Of if-then-else, given what one of its ends costs."""
        test, yes, no = arguments
        total = self._circuit.total
        return self._circuit.least(
            [
                total([self.truth(test, True), cost(yes)]),
                total([self.truth(test, False), cost(no)]),
            ]
        )

    def _equals(self, node: int, value: object) -> int:
        graph, circuit = self._graph, self._circuit
        operator, arguments = graph.operators[node], graph.arguments[node]
        if operator == "constant":
            return circuit.free if graph.values[node] == value else circuit.impossible
        if operator == "if":
            return self._chosen(arguments, lambda each: self.equals(each, value))
        if graph.is_bool[node]:
            return self.truth(node, bool(value)) if value in (0, 1) else circuit.impossible
        if operator != "leaf":
            return circuit.free
        if graph.depends[node] == Kind.STATE:
            known = self.values(self._variables[graph.values[node]])
            if not known:
                return circuit.free
            if not isinstance(value, int) or value not in known:
                return circuit.impossible
            return self._leaf(node, value)
        return self._leaf(node, value) if isinstance(value, int) else circuit.free

    def _differs(self, node: int, value: object) -> int:
        graph, circuit = self._graph, self._circuit
        if graph.is_constant(node):
            return circuit.impossible if graph.values[node] == value else circuit.free
        if graph.is_bool[node]:
            return self.truth(node, not value) if value in (0, 1) else circuit.free
        if graph.operators[node] == "leaf" and graph.depends[node] == Kind.STATE:
            known = self.values(self._variables[graph.values[node]])
            others = [self._leaf(node, each) for each in known if each != value]
            return circuit.least(others) if known else circuit.free
        return self.positive(node) if value == 0 and self._is_positive_or_0(node) else circuit.free

    def _happens(self, node: int) -> int:
        graph, circuit = self._graph, self._circuit
        if graph.is_bool[node]:
            return self.truth(node, True)
        operator, arguments = graph.operators[node], graph.arguments[node]
        if operator == "constant":
            return circuit.constant(chance_cost(float(graph.values[node])))
        if operator == "*":
            return circuit.total(map(self.happens, arguments))
        if operator in ("+", "max", "maximum"):
            return circuit.least(map(self.happens, arguments))
        if operator == "-" and arguments[0] == graph.one:
            return self.fails(arguments[1])
        if operator == "if":
            return self._chosen(arguments, self.happens)
        if operator in ("-", "/"):
            return self.happens(arguments[0])
        return circuit.free

    def _positive(self, node: int) -> int:
        graph, circuit = self._graph, self._circuit
        if graph.is_bool[node]:
            return self.truth(node, True)
        operator, arguments = graph.operators[node], graph.arguments[node]
        if operator == "constant":
            return circuit.free if graph.values[node] > 0 else circuit.impossible
        if operator in ("+", "max", "maximum"):
            return circuit.least(map(self.positive, arguments))
        if operator == "if":
            return self._chosen(arguments, self.positive)
        if operator == "-" and arguments[0] == graph.one and graph.is_bool[arguments[1]]:
            return self.truth(arguments[1], False)
        # of a difference the first is above 0 if the second is not below
        if operator not in ("*", "-", "/") or not all(map(self._is_positive_or_0, arguments)):
            return circuit.free
        parts = arguments if operator == "*" else arguments[:1]
        return circuit.total(map(self.positive, parts))

    def _is_positive_or_0(self, node: int) -> bool:
        """Whether a number is seen to be never below 0."""
        return bool(self._once(self._never_below_0, node))

    def _never_below_0(self, node: int) -> bool:
        graph = self._graph
        if graph.is_bool[node]:
            return True
        operator, arguments = graph.operators[node], graph.arguments[node]
        if operator == "constant":
            return bool(graph.values[node] >= 0)
        if operator == "-":
            return arguments[0] == graph.one and graph.is_bool[arguments[1]]
        parts = arguments[1:] if operator == "if" else arguments
        known = ("*", "+", "/", "if", "max", "maximum")
        return operator in known and all(map(self._is_positive_or_0, parts))

    def _fails(self, node: int) -> int:
        graph, circuit = self._graph, self._circuit
        if graph.is_bool[node]:
            return self.truth(node, False)
        operator, arguments = graph.operators[node], graph.arguments[node]
        if operator == "constant":
            return circuit.constant(chance_cost(1.0 - float(graph.values[node])))
        if operator == "*":
            return circuit.least(map(self.fails, arguments))
        # each must fail: (1 - p) (1 - q) >= 1 - (p + q) is never too dear where none is below 0
        if operator == "+" and all(map(self._is_chance, arguments)):
            return circuit.total(map(self.fails, arguments))
        if operator == "-" and arguments[0] == graph.one:
            return self.happens(arguments[1])
        if operator == "if":
            return self._chosen(arguments, self.fails)
        return circuit.free

    def _is_chance(self, node: int) -> bool:
        """Whether a part of a probability is seen to be never below 0, as 1 - p is not."""
        graph = self._graph
        operator, arguments = graph.operators[node], graph.arguments[node]
        if operator == "-" and arguments[0] == graph.one:
            return self._is_chance(arguments[1])
        if operator == "*":
            return all(map(self._is_chance, arguments))
        return self._is_positive_or_0(node)
