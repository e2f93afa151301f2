"""The expressions of a lifted model, for given objects, as nodes of a graph."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import Any

import numpy as np

from mdpo_rddl.problem.enumeration.forms import Forms, is_whole
from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.laws import Branch, Law, Laws
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.operators import FUNCTION_NAMES, OPERATORS

Ground = tuple[str, tuple[int, ...]]
"""A fluent and the indices of its objects."""
Binding = Mapping[str, int]

# bindings of an aggregation, between two looks at the clock
_CHECK_EVERY = 1024
# of objects, at which a fluent is looked up where the state says at which
_MAX_PLACES = 4096
_LEAVES = {"state-fluent": Kind.STATE, "action-fluent": Kind.ACTION}
_BOOLEAN = {"^": "and", "&": "and", "|": "or", "=>": "implies", "<=>": "iff"}
_AGGREGATIONS = {
    "sum": "+",
    "prod": "*",
    "avg": "avg",
    "minimum": "minimum",
    "maximum": "maximum",
    "forall": "and",
    "exists": "or",
}


class Grounder:
    """Grounds expressions; non-fluents become constants.

    Attributes:
      graph: of the nodes.
      drawn: random fluents that other expressions refer to, with the leaves that stand for them.
    """

    def __init__(self, rddl: Any, values: Mapping[str, Any], limits: EnumerationLimits) -> None:
        """Starts an empty graph.

        Args:
          rddl: pyRDDLGym's lifted model.
          values: of the non-fluents, as pyRDDLGym's simulator holds them.
          limits: for the time.
        """
        self.graph = Graph()
        self.laws = Laws(self.graph)
        self.drawn: dict[Ground, int] = {}
        self._rddl, self._values, self._limits = rddl, values, limits
        self._known: dict[Ground, Law] = {}
        self._open: set[Ground] = set()
        self._forms = Forms(rddl)

    def fluent(self, name: str, indices: tuple[int, ...]) -> Law:
        """The law of a fluent that a conditional probability function defines."""
        ground = (name, indices)
        if ground not in self._known:
            if ground in self._open:
                raise NotEnumerableError(f"{name} depends on itself")
            self._open.add(ground)
            self._limits.check_time()
            parameters, expression = self._rddl.cpfs[name]
            binding = {
                variable: index
                for (variable, _), index in zip(parameters or [], indices, strict=True)
            }
            self._known[ground] = self.law(expression, binding)
        return self._known[ground]

    def law(self, expression: Any, binding: Binding) -> Law:
        """The law of an expression.

        Raises:
          NotEnumerableError: for a form that is not understood.
        """
        if not self._forms.is_random(expression):
            return self.laws.certain(self.node(expression, binding))
        kind, name, arguments = self._forms(expression)
        if kind == "randomvar":
            return self._draw(name, arguments, binding)
        if kind == "control":
            return self._chosen(*self._cases(expression, binding), binding)
        if kind == "pvar":
            return self._drawn_place(expression, binding)
        operator, parts = self._parts(expression, binding)
        return self._combine(operator, [self.law(each, bound) for each, bound in parts])

    def node(self, expression: Any, binding: Binding) -> int:
        """The node of an expression without a draw of its own."""
        kind, _, arguments = self._forms(expression)
        if kind == "constant":
            return self.graph.constant(arguments)
        if kind == "pvar":
            return self._variable(arguments, binding)
        if kind == "control":
            (only,) = self._chosen(*self._cases(expression, binding), binding)
            return only.value
        operator, parts = self._parts(expression, binding)
        if operator in ("and", "or"):
            return self._junction(operator, parts)
        if operator == "*":
            return self._product(parts)
        nodes = [self.node(each, bound) for each, bound in parts]
        if operator in OPERATORS and nodes:
            return self.graph.make(operator, *nodes)
        return self._combine(operator, [self.laws.certain(node) for node in nodes])[0].value

    def _cases(self, expression: Any, binding: Binding) -> tuple[list[tuple[Law, Any]], Any]:
        """Conditions with what each chooses, the first that holds, and what is chosen else."""
        _, name, (condition, *choices) = self._forms(expression)
        if name == "if":
            yes, no = choices
            return [(self.law(condition, binding), yes)], no
        if self._forms.is_random(condition):
            raise NotEnumerableError("a switch on a draw")
        graph, subject = self.graph, self.node(condition, binding)
        *cases, (kind, last) = sorted(choices, key=lambda choice: choice[0] == "default")
        tests = [
            self.laws.certain(graph.make("==", subject, graph.constant(self._object(value))))
            for _, (value, _) in cases
        ]
        chosen = [each for _, (_, each) in cases]
        # without a default its cases are all that there is
        return list(zip(tests, chosen, strict=True)), last if kind == "default" else last[1]

    def _chosen(self, cases: Sequence[tuple[Law, Any]], otherwise: Any, binding: Binding) -> Law:
        """The law of a choice; what a constant rules out is not looked at."""
        if not cases:
            return self.law(otherwise, binding)
        (test, chosen), *rest = cases
        if len(test) == 1 and self.graph.is_constant(test[0].value):
            if self.graph.values[test[0].value]:
                return self.law(chosen, binding)
            return self._chosen(rest, otherwise, binding)
        return self.laws.choose(
            test, self.law(chosen, binding), self._chosen(rest, otherwise, binding)
        )

    def _junction(self, operator: str, parts: Iterator[tuple[Any, Binding]]) -> int:
        """A conjunction or disjunction, left as soon as a constant decides it."""
        decides = self.graph.false if operator == "and" else self.graph.true
        nodes = []
        for each, bound in parts:
            node = self.node(each, bound)
            if node == decides:
                return node
            nodes.append(node)
        return self.graph.make(operator, *nodes) if nodes else self._empty(operator)

    def _product(self, parts: Iterator[tuple[Any, Binding]]) -> int:
        nodes = []
        for each, bound in parts:
            node = self.node(each, bound)
            if node in (self.graph.zero, self.graph.false):
                return self.graph.zero
            nodes.append(node)
        return self.graph.make("*", *nodes) if nodes else self._empty("*")

    def _empty(self, operator: str) -> int:
        neutral = {"and": True, "or": False, "+": 0, "*": 1}
        if operator not in neutral:
            raise NotEnumerableError("an aggregation over no object")
        return self.graph.constant(neutral[operator])

    def _combine(self, operator: str, laws: list[Law]) -> Law:
        if not laws:
            return self.laws.certain(self._empty(operator))
        if operator == "implies":
            return self.laws.apply("or", [self.laws.apply("not", laws[:1]), laws[1]])
        if operator == "negative":
            return self.laws.apply("*", [self.laws.certain(self.graph.constant(-1)), *laws])
        if operator == "avg":
            count = self.laws.certain(self.graph.constant(len(laws)))
            return self.laws.apply("/", [self.laws.apply("+", laws), count])
        return self.laws.apply(operator, laws)

    def _parts(
        self, expression: Any, binding: Binding
    ) -> tuple[str, Iterator[tuple[Any, Binding]]]:
        """An operator, and the expressions that it is applied to."""
        kind, name, arguments = self._forms(expression)
        if kind == "aggregation" and name in _AGGREGATIONS:
            *typed, body = arguments
            return _AGGREGATIONS[name], self._bindings(typed, body, binding)
        plain = [(each, binding) for each in arguments]
        if kind == "boolean":
            unary = "not" if len(plain) == 1 else "xor"
            return _BOOLEAN.get(name, unary), iter(plain)
        if kind == "arithmetic":
            is_negative = name == "-" and len(plain) == 1
            return "negative" if is_negative else name, iter(plain)
        if kind == "func" and name == "fmod" and is_whole(self._rddl, expression):
            return "mod", iter(plain)
        if kind == "relational" or (kind == "func" and name in FUNCTION_NAMES):
            return name, iter(plain)
        raise NotEnumerableError(f"an expression that is not understood: {kind} {name}")

    def _bindings(
        self, typed: list[Any], body: Any, binding: Binding
    ) -> Iterator[tuple[Any, Binding]]:
        variables = [variable for _, variable in typed]
        names = [name for name, _ in variables]
        sizes = [range(len(self._rddl.type_to_objects[kind])) for _, kind in variables]
        for count, indices in enumerate(product(*sizes)):
            if count % _CHECK_EVERY == 0:
                self._limits.check_time()
            yield body, {**binding, **dict(zip(names, indices, strict=True))}

    def _variable(self, place: tuple[str, Any], binding: Binding) -> int:
        name, arguments = place
        if name in binding:
            return self.graph.constant(binding[name])
        if arguments is None and name not in self._rddl.variable_types:
            return self.graph.constant(self._object(name))
        return self._at(name, [self._place(each, binding) for each in arguments or []])

    def _drawn_place(self, expression: Any, binding: Binding) -> Law:
        """The law of a fluent whose object is drawn."""
        name, arguments = expression.args
        places = [
            self.laws.certain(self._place(each, binding))
            if isinstance(each, str)
            else self.law(each, binding)
            for each in arguments
        ]
        branches = []
        for chosen in product(*places):
            value = self._at(name, [each.value for each in chosen])
            branches.append(
                Branch(value, self.graph.make("*", *(each.probability for each in chosen)))
            )
        return self.laws.collected(branches)

    def _at(self, name: str, places: list[int]) -> int:
        """The node of a fluent whose objects are nodes: a choice where they are not known."""
        graph = self.graph
        unknown = [number for number, node in enumerate(places) if not graph.is_constant(node)]
        if not unknown:
            return self._fluent_node(name, tuple(int(graph.values[node]) for node in places))
        sizes = [len(self._rddl.type_to_objects[kind]) for kind in self._types(name)]
        if prod(sizes[number] for number in unknown) > _MAX_PLACES:
            raise NotEnumerableError("a fluent whose object depends on the state")
        first = unknown[0]
        nodes = [
            self._at(name, [*places[:first], graph.constant(place), *places[first + 1 :]])
            for place in range(sizes[first])
        ]
        chosen = nodes[-1]
        for place in reversed(range(sizes[first] - 1)):
            test = graph.make("==", places[first], graph.constant(place))
            chosen = graph.make("if", test, nodes[place], chosen)
        return chosen

    def _types(self, name: str) -> list[str]:
        return list(self._rddl.variable_params[name])

    def _fluent_node(self, name: str, indices: tuple[int, ...]) -> int:
        kind = self._rddl.variable_types[name]
        if kind == "non-fluent":
            return self.graph.constant(np.asarray(self._values[name])[indices])
        is_bool = self._rddl.variable_ranges[name] == "bool"
        if kind in _LEAVES:
            return self.graph.leaf(_LEAVES[kind], (name, indices), is_bool)
        law = self.fluent(name, indices)
        if len(law) == 1:
            return law[0].value
        leaf = self.graph.leaf(Kind.DRAWN, (name, indices), is_bool)
        self.drawn[name, indices] = leaf
        return leaf

    def _place(self, argument: Any, binding: Binding) -> int:
        """The node of an object's index."""
        if not isinstance(argument, str):
            return self.node(argument, binding)
        known = binding[argument] if argument in binding else self._object(argument)
        return self.graph.constant(known)

    def _object(self, name: str) -> int:
        try:
            return self._rddl.object_to_index[name.removeprefix("@")]
        except KeyError:
            raise NotEnumerableError(f"a name that is not understood: {name}") from None

    def _draw(self, name: str, arguments: Any, binding: Binding) -> Law:
        if name in ("KronDelta", "DiracDelta"):
            return self.law(arguments[0], binding)
        if name == "Bernoulli":
            if self._forms.is_random(arguments[0]):
                raise NotEnumerableError("a random probability")
            return self.laws.bernoulli(self.node(arguments[0], binding))
        if name in ("Discrete", "UnnormDiscrete"):
            cases = [case for _, case in arguments[1:]]
            weights = [self.node(weight, binding) for _, weight in cases]
            values = [self._object(value) for value, _ in cases]
            return self._one_of(values, weights, is_law=name == "Discrete")
        if name in ("Discrete(p)", "UnnormDiscrete(p)"):
            typed, (weight,) = arguments
            nodes = [self.node(*each) for each in self._bindings([typed], weight, binding)]
            return self._one_of(range(len(nodes)), nodes, is_law=name == "Discrete(p)")
        raise NotEnumerableError(f"a draw from {name}")

    def _one_of(self, values: Sequence[int], weights: Sequence[int], is_law: bool) -> Law:
        """One of the values, each as likely as its weight's node says.

        Args:
          values: from which it is drawn.
          weights: nodes, one for each value.
          is_law: whether the weights must be probabilities; else only their ratios count. What the
            environment refuses is no law afterwards either: sums other than 1, negative weights.
        """
        graph = self.graph
        if not is_law:
            total = graph.make("+", *(graph.make("abs", weight) for weight in weights))
            weights = [graph.make("/", weight, total) for weight in weights]
        pairs = zip(values, weights, strict=True)
        return tuple(Branch(graph.constant(value), weight) for value, weight in pairs)
