"""RDDL expressions as closures over flat scopes.

An expression is evaluated for K tuples of objects (`Scope`) and B replicas at once, as one array
[K, B]; [1, B] where no tuple matters, [K, 1] where no replica does. Compilation has two passes:

1. `Compiler.lower` turns an expression at a scope into a graph of `Node`s. What reads non-fluents
   alone is folded into a constant. A compound expression is evaluated for the distinct tuples of
   the variables that it reads, and its rows are gathered where more are wanted. Equal expressions
   at equal tuples are one node. A sum or quantifier drops the tuples that its static conditions
   rule out while its scope is laid out, one variable after the other.
2. `link` turns nodes into closures. Nodes with several users keep their value for the step.

Where pyRDDLGym skips an operand (a product whose first factor is zero everywhere, `^`, `|`, and
`if` with one branch) an error in it is none: `Frame.active` has the replicas that evaluate it.
Draws are made there, too, which changes no law.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel
from pyRDDLGym.core.parser.expr import Expression

from mdpo_rddl.simulator.laws import (
    ALIKE_RESULTS,
    BINARY,
    INT,
    LAWS,
    REAL,
    RELATIONS,
    UNARY,
    UNIFORM,
    WHOLE_RESULTS,
    sums_to_one,
)
from mdpo_rddl.simulator.scopes import Scope

DTYPES: Mapping[str, Any] = {"b": np.bool_, "i": INT, "f": REAL}
ARITHMETIC: Mapping[str, Any] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
}
AGGREGATIONS: Mapping[str, Any] = {
    "sum": np.add,
    "prod": np.multiply,
    "exists": np.bitwise_or,
    "forall": np.bitwise_and,
    "minimum": np.minimum,
    "maximum": np.maximum,
}
IDENTITIES = {"sum": 0, "prod": 1, "exists": False, "forall": True}
# numpy adds up contiguous numbers in eight lanes, and halves what is longer than a block
_LANES, _BLOCK = 8, 128


class UnsupportedError(ValueError):
    """An expression that the simulator cannot evaluate."""


class Frame:
    """What one step of a block of replicas is evaluated on.

    Attributes:
      values: per fluent its value [ground fluents, B].
      generator: makes all draws.
      replicas: how many B.
      active: [B], who evaluates the present operand; None for all.
      lost: [B], whose environment would have raised an error.
      memo: values of nodes with several users.
    """

    __slots__ = ("active", "generator", "lost", "memo", "replicas", "values")

    def __init__(self, values: dict[str, np.ndarray], generator: Any, replicas: int, slots: int):
        self.values, self.generator, self.replicas = values, generator, replicas
        self.active: np.ndarray | None = None
        self.lost: np.ndarray = np.zeros(replicas, bool)
        self.memo: list[Any] = [None] * slots

    def forget(self) -> None:
        """Drops the kept values, since fluents have changed."""
        self.memo = [None] * len(self.memo)

    def lose(self, bad: np.ndarray) -> None:
        """Marks replicas (a mask [K or 1, B or 1]) as lost, as far as they are active."""
        columns = bad.any(axis=0)
        self.lost |= columns if self.active is None else columns & self.active


Closure = Callable[[Frame], np.ndarray]


@dataclass(eq=False)
class Node:
    """A value to be computed.

    Attributes:
      rows: K, or 1.
      kind: `b`, `i` or `f`.
      make: closures of the arguments -> closure; None where `value` is given.
      args: the arguments.
      value: a constant [rows, 1].
      varies: whether it has a column for each replica.
      checks: whether computing it may lose replicas.
      fresh: whether its array is new, so that the only user may write into it.
      shared: whether it has several users.
      kept: whether its value is kept for the step where it is shared, though it has no arguments.
    """

    rows: int
    kind: str
    make: Callable[..., Closure] | None = None
    args: tuple["Node", ...] = ()
    value: np.ndarray | None = None
    varies: bool = True
    checks: bool = False
    fresh: bool = True
    shared: bool = False
    kept: bool = False
    closure: Closure | None = field(default=None, repr=False)

    def may_be_overwritten(self, rows: int, kind: str) -> bool:
        """Whether a result of these rows and this kind fits into its array, read by nobody else."""
        owned = self.fresh and not self.shared and self.value is None
        return owned and self.varies and (self.rows, self.kind) == (rows, kind)


class Traits(NamedTuple):
    """What is known of an expression without a scope.

    Attributes:
      free: variables that it reads and does not bind.
      static: whether it reads non-fluents and objects alone.
      draws: whether it draws.
      raises: whether pyRDDLGym may raise an error there, draws aside.
      wild: whether its value may be infinite or no number where all fluents are finite.
    """

    free: frozenset[str]
    static: bool
    draws: bool
    raises: bool
    wild: bool


# what an aggregation is a sum of, in the algebra in which it is one
_FACTORS = {"exists": ("^", "&"), "forall": ("|",), "sum": ("*",)}
# a scope of so many tuples is laid out in less than a tenth of a second
_MANY_ROWS = 2**20
_WILD = {"ln", "log", "exp", "pow", "tan", "acos", "asin", "cosh", "sinh", "sqrt", "fmod"}


def typed(variables: Sequence[Any]) -> list[tuple[str, str]]:
    """The (variable, type) pairs of a binder."""
    return [pair for _, pair in variables]


class Compiler:
    """Lowers expressions of one model."""

    def __init__(
        self,
        model: RDDLLiftedModel,
        non_fluents: Mapping[str, np.ndarray],
        shapes: Mapping[str, tuple[int, ...]],
        functions: Mapping[str, Callable[..., Any]],
    ) -> None:
        """Keeps what expressions are read against.

        Args:
          model: pyRDDLGym's lifted model.
          non_fluents: their values, flat.
          shapes: of all fluents and non-fluents.
          functions: external Python functions, by name.
        """
        self._model, self._constants, self._shapes = model, dict(non_fluents), shapes
        self._functions = functions
        self._traits: dict[int, Traits] = {}
        self._texts: dict[int, tuple[str, tuple[str, ...]]] = {}
        self._nodes: dict[Any, Node] = {}
        self.slots = 0
        self.largest = 1
        """The most bytes of a node for one replica."""
        self._made: list[Any] = []
        self._bases: dict[tuple[Scope, str, int], Node] = {}
        self._drawn: dict[tuple[Scope, str], int] = {}

    # --- what an expression reads --------------------------------------------------------

    def traits(self, e: Any) -> Traits:
        """What is known of an expression without a scope."""
        if id(e) not in self._traits:
            self._traits[id(e)] = self._find_traits(e)
        return self._traits[id(e)]

    def _find_traits(self, e: Any) -> Traits:
        kind, name = e.etype
        bound, parts = _parts(e)
        inner = [self.traits(part) for part in parts]
        free = frozenset().union(*(each.free for each in inner)) - set(bound)
        static = all(each.static for each in inner)
        draws = any(each.draws for each in inner)
        raises = any(each.raises for each in inner)
        wild = any(each.wild for each in inner)
        if kind == "pvar":
            variable, arguments = e.args
            if variable.startswith("?"):
                free |= {variable}
            elif not self._is_object(variable, arguments):
                free |= {a for a in arguments or () if isinstance(a, str) and a.startswith("?")}
                static &= variable in self._constants
        elif kind in ("randomvar", "randomvector") and name not in ("KronDelta", "DiracDelta"):
            static, draws = False, True
            if kind == "randomvector":
                free |= set(e.args[0])
        elif kind == "pyfunc":
            static, draws, free = False, True, free | set(e.args[0])
        elif kind == "matrix" and name != "det":
            free |= set(e.args[0])
        return Traits(free, static, draws, raises or _raises(e), wild or _is_wild(e))

    def _is_object(self, name: str, arguments: Any) -> bool:
        return not arguments and name not in self._shapes and self._model.is_object(name)

    def _text(self, e: Any) -> tuple[str, tuple[str, ...]]:
        """The expression with its free variables numbered, and these in their order."""
        if id(e) not in self._texts:
            order: dict[str, int] = {}
            text = self._write(e, {}, order)
            self._texts[id(e)] = text, tuple(order)
        return self._texts[id(e)]

    def _write(self, e: Any, bound: Mapping[str, str], order: dict[str, int]) -> str:
        if isinstance(e, str):
            if e in bound:
                return bound[e]
            return f"?{order.setdefault(e, len(order))}" if e.startswith("?") else repr(e)
        if isinstance(e, (list, tuple)):
            return f"({','.join(self._write(each, bound, order) for each in e)})"
        if not hasattr(e, "etype"):
            return repr(e)
        variables, _ = _parts(e)
        if variables:
            bound = {**bound, **{v: f"!{len(bound) + i}" for i, v in enumerate(variables)}}
        return f"{e.etype[0]}:{e.etype[1]}{self._write(e.args, bound, order)}"

    # --- lowering ------------------------------------------------------------------------

    def lower(self, e: Any, scope: Scope) -> Node:
        """The node of an expression at each tuple of a scope.

        Raises `UnsupportedError` for what the simulator does not know.
        """
        kind, name = e.etype
        traits = self.traits(e)
        if kind == "pvar":
            variable, arguments = e.args
            return self._pvar(variable, arguments, scope)
        method = getattr(self, f"_{kind}", None)
        if method is None:
            raise UnsupportedError(f"the simulator does not know the expression {kind} {name}")
        if traits.draws or traits.raises:
            return self._counted(method(e, scope))
        narrow, numbers = scope.restricted(traits.free)
        text, order = self._text(e)
        key = (text, narrow.rows, *(narrow.signature[variable] for variable in order))
        found = self._nodes.get(key)
        if found is None:
            found = self._nodes[key] = self._counted(method(e, narrow))
        else:
            found.shared = True
        if numbers is None or found.rows == 1:
            return found
        spread = (key, numbers.tobytes())
        if spread in self._nodes:
            self._nodes[spread].shared = True
        else:
            self._nodes[spread] = self._rows(found, numbers)
        return self._nodes[spread]

    def _counted(self, node: Node) -> Node:
        if node.value is None:
            self.largest = max(self.largest, node.rows * np.dtype(DTYPES[node.kind]).itemsize)
        return node

    def link(self, node: Node) -> Closure:
        """The closure of a node. All expressions are lowered before the first one is linked."""
        if node.value is not None:
            constant = node.value
            return lambda frame: constant
        if node.closure is None:
            assert node.make is not None
            node.closure = node.make(*map(self.link, node.args))
            if node.shared and (node.args or node.kept):
                node.closure = self._kept(node.closure)
        return node.closure

    def _kept(self, closure: Closure) -> Closure:
        slot = self.slots
        self.slots += 1

        def kept(frame: Frame) -> np.ndarray:
            value = frame.memo[slot]
            if value is None:
                value = frame.memo[slot] = closure(frame)
            return value

        return kept

    def _rows(self, node: Node, numbers: np.ndarray) -> Node:
        """Rows of a node by their numbers [K]."""
        if node.value is not None:
            return _constant(node.value[numbers], node.kind)
        first, count = int(numbers[0]), len(numbers)
        if (numbers == np.arange(first, first + count)).all():
            if count == node.rows:
                return node
            last = first + count
            return self._over((node,), lambda f: lambda s: f(s)[first:last], count, fresh=False)
        taken = self._over((node,), lambda f: lambda s: f(s).take(numbers, axis=0), count)
        return self._counted(taken)

    def _over(
        self,
        args: tuple[Node, ...],
        make: Callable[..., Closure],
        rows: int,
        kind: str | None = None,
        fresh: bool = True,
    ) -> Node:
        return Node(
            rows,
            kind or args[0].kind,
            make,
            args,
            varies=any(arg.varies for arg in args),
            checks=any(arg.checks for arg in args),
            fresh=fresh,
        )

    def _elementwise(self, function: Callable[..., Any], kind: str, *args: Node) -> Node:
        """A function of numbers, row by row and replica by replica."""
        if all(arg.value is not None for arg in args):
            return _constant(function(*(arg.value for arg in args)), kind)
        rows = max(arg.rows for arg in args)

        def make(*fs: Closure) -> Closure:
            into = None
            if isinstance(function, np.ufunc):
                fits = (i for i, arg in enumerate(args) if arg.may_be_overwritten(rows, kind))
                into = next(fits, None)
            return _applied(function, fs, args, into)

        return self._over(args, make, rows, kind)

    def fix(self, name: str, node: Node) -> bool:
        """Makes a fluent whose value is known a constant; says whether it is."""
        if node.value is None:
            return False
        value = node.value.astype(DTYPES[self.kind(name)])
        self._constants[name] = np.broadcast_to(value[:, 0], math.prod(self._shapes[name]))
        return True

    def _number(self, node: Node) -> Node:
        return self._cast(node, "i") if node.kind == "b" else node

    def _bool(self, node: Node) -> Node:
        return node if node.kind == "b" else self._cast(node, "b")

    def _cast(self, node: Node, kind: str) -> Node:
        dtype = DTYPES[kind]
        return self._elementwise(lambda x: np.asarray(x).astype(dtype), kind, node)

    # --- leaves --------------------------------------------------------------------------

    def _constant(self, e: Any, scope: Scope) -> Node:
        return _constant(np.full((1, 1), e.args))

    def _pvar(self, name: str, arguments: Sequence[Any] | None, scope: Scope) -> Node:
        if name.startswith("?"):
            return _constant(scope.columns[name][:, None])
        if self._is_object(name, arguments):
            return _constant(np.full((1, 1), self._index(name)))
        shape = self._shapes[name]
        kind = self.kind(name)
        if not arguments:
            return self._fluent(name, kind)
        parts = [
            (self._pvar(part, None, scope) if part.startswith("?") else self._literal(part))
            if isinstance(part, str)
            else self.lower(part, scope)
            for part in arguments
        ]
        if all(part.value is not None for part in parts):
            values = [part.value for part in parts]
            columns = [np.broadcast_to(value[:, 0], scope.rows) for value in values]  # type: ignore[index]
            numbers = np.ravel_multi_index(columns, shape)
            key = (name, numbers.tobytes())
            if key in self._nodes:
                self._nodes[key].shared = True
            else:
                self._nodes[key] = self._rows(self._fluent(name, kind), numbers)
            return self._nodes[key]
        return self._gather(name, kind, parts, scope.rows)

    def _gather(self, name: str, kind: str, parts: list[Node], rows: int) -> Node:
        """A fluent at objects that are values themselves."""
        strides = [math.prod(self._shapes[name][i + 1 :]) for i in range(len(parts))]
        constant = self._constants.get(name)
        args = tuple(parts) if constant is not None else (*parts, self._fluent(name, kind))

        def make(*fs: Closure) -> Closure:
            def gather(s: Frame) -> np.ndarray:
                index = sum(f(s) * stride for f, stride in zip(fs, strides, strict=False))
                if constant is not None:
                    return constant.take(index)
                table = fs[-1](s)
                index = np.broadcast_to(index, (rows, s.replicas))
                return np.take_along_axis(table, index, axis=0)

            return gather

        return self._over(args, make, rows, kind)

    def _fluent(self, name: str, kind: str) -> Node:
        rows = math.prod(self._shapes[name])
        if name in self._constants:
            return _constant(self._constants[name].reshape(rows, 1), kind)
        return Node(rows, kind, lambda: lambda s: s.values[name], fresh=False)

    def kind(self, name: str) -> str:
        """`b`, `i` or `f`, by the range of a fluent."""
        return {"bool": "b", "real": "f"}.get(self._model.variable_ranges[name], "i")

    def _literal(self, name: str) -> Node:
        return _constant(np.full((1, 1), self._index(name)))

    def _index(self, name: str) -> int:
        return int(self._model.object_to_index[name.lstrip("@")])

    # --- operators -----------------------------------------------------------------------

    def _arithmetic(self, e: Any, scope: Scope) -> Node:
        _, op = e.etype
        if op == "*":
            return self._product(_simple_first(e.args), scope)
        nodes = [self.lower(arg, scope) for arg in e.args]
        if len(nodes) == 1:
            node = self._number(nodes[0])
            return self._elementwise(np.negative, node.kind, node)
        result = nodes[0]
        for node in nodes[1:]:
            if result.kind == "b" and node.kind == "b":
                result = self._number(result)
            kind = "f" if op == "/" else _promoted(result, node)
            result = self._elementwise(ARITHMETIC[op], kind, result, node)
        return result

    def _product(self, args: Sequence[Any], scope: Scope) -> Node:
        result = self.lower(args[0], scope)
        for arg in args[1:]:
            node = self.lower(arg, scope)
            if result.kind == "b" and node.kind == "b":
                result = self._number(result)
            kind = _promoted(result, node)
            if node.checks or self.traits(arg).wild:
                result = self._guarded_product(result, node, kind)
            else:
                result = self._elementwise(np.multiply, kind, result, node)
        return result

    def _guarded_product(self, first: Node, second: Node, kind: str) -> Node:
        """A product whose second factor pyRDDLGym skips where the first one is zero everywhere."""

        def make(f: Closure, g: Closure) -> Closure:
            def product(s: Frame) -> np.ndarray:
                x = f(s)
                y = within(s, x.any(axis=0), g) if second.checks else g(s)
                value = x * y
                if not np.isfinite(value).all():
                    value = np.where(x.any(axis=0), value, 0)
                return value

            return product

        if first.value is not None and second.value is not None:
            value = first.value * second.value if first.value.any() else first.value
            return _constant(value, kind)
        return self._over((first, second), make, max(first.rows, second.rows), kind)

    def _relational(self, e: Any, scope: Scope) -> Node:
        return self._elementwise(
            RELATIONS[e.etype[1]], "b", *(self.lower(arg, scope) for arg in e.args)
        )

    def _boolean(self, e: Any, scope: Scope) -> Node:
        _, op = e.etype
        if op == "~" and len(e.args) == 1:
            node = self._bool(self.lower(e.args[0], scope))
            return self._elementwise(np.bitwise_not, "b", node)
        if op in ("^", "&", "|"):
            return self._connective(op == "|", _simple_first(e.args), scope)
        nodes = [self._bool(self.lower(arg, scope)) for arg in e.args]
        if op == "=>":
            negated = self._elementwise(np.bitwise_not, "b", nodes[0])
            return self._elementwise(np.bitwise_or, "b", negated, nodes[1])
        return self._elementwise(np.bitwise_xor if op == "~" else np.equal, "b", *nodes)

    def _connective(self, is_or: bool, args: Sequence[Any], scope: Scope) -> Node:
        function = np.bitwise_or if is_or else np.bitwise_and
        result = self._bool(self.lower(args[0], scope))
        for arg in args[1:]:
            node = self._bool(self.lower(arg, scope))
            # what a constant decides is not evaluated
            if result.value is not None and (result.value == is_or).all():
                return result
            if node.value is not None and (node.value == is_or).all():
                result = node
            elif node.checks:
                result = self._guarded_connective(function, is_or, result, node)
            else:
                result = self._elementwise(function, "b", result, node)
        return result

    def _guarded_connective(self, function: Any, is_or: bool, first: Node, second: Node) -> Node:
        def make(f: Closure, g: Closure) -> Closure:
            def connective(s: Frame) -> np.ndarray:
                x = f(s)
                open_ = ~x.all(axis=0) if is_or else x.any(axis=0)
                return function(x, within(s, open_, g))

            return connective

        return self._over((first, second), make, max(first.rows, second.rows), "b")

    def _func(self, e: Any, scope: Scope) -> Node:
        _, name = e.etype
        nodes = [self._number(self.lower(arg, scope)) for arg in e.args]
        are_whole = all(node.kind == "i" for node in nodes)
        kind = "i" if name in WHOLE_RESULTS or (name in ALIKE_RESULTS and are_whole) else "f"
        function = UNARY.get(name) if len(nodes) == 1 else BINARY.get(name)
        if function is None:
            raise UnsupportedError(f"the simulator does not know the function {name}")
        if name in ("lngamma", "gamma"):
            return self._checked(function, kind, lambda x: x > 0, (1.0,), *nodes)
        if name == "pow" and kind == "i" and self.traits(e).raises:
            return self._checked(
                function, kind, lambda x, y: (y >= 0) & np.ones(x.shape, bool), (1, 1), *nodes
            )
        return self._elementwise(function, kind, *nodes)

    def _checked(
        self,
        function: Callable[..., Any],
        kind: str,
        domain: Callable[..., Any],
        safe: tuple[float, ...],
        *nodes: Node,
    ) -> Node:
        """A function that loses the replicas whose arguments leave its domain."""

        def make(*fs: Closure) -> Closure:
            def checked(s: Frame) -> np.ndarray:
                return function(*sound(s, [f(s) for f in fs], domain, safe))

            return checked

        values = [node.value for node in nodes]
        if all(value is not None for value in values) and np.all(domain(*values)):
            return _constant(function(*values), kind)
        node = self._over(nodes, make, max(each.rows for each in nodes), kind)
        node.checks = True
        return node

    # --- control flow --------------------------------------------------------------------

    def _control(self, e: Any, scope: Scope) -> Node:
        if e.etype[1] == "switch":
            return self._switch(e, scope)
        condition = self._bool(self.lower(e.args[0], scope))
        if condition.value is not None and condition.value.all():
            return self.lower(e.args[1], scope)
        if condition.value is not None and not condition.value.any():
            return self.lower(e.args[2], scope)
        return self._choice(condition, *self._branches(e.args[1:], scope))

    def _branches(self, branches: Sequence[Any], scope: Scope) -> list[Node]:
        """The nodes of expressions of which one is evaluated.

        The n-th draw of each is made of the same numbers, which changes no law.
        """
        nodes, before, most = [], dict(self._drawn), dict(self._drawn)
        for branch in branches:
            self._drawn = dict(before)
            nodes.append(self.lower(branch, scope))
            for key, count in self._drawn.items():
                most[key] = max(count, most.get(key, 0))
        self._drawn = most
        return nodes

    def _base(self, method: str, scope: Scope) -> Node:
        """The next draws [K, B] of a generator's method."""
        number = self._drawn.get((scope, method), 0)
        self._drawn[scope, method] = number + 1
        key, rows = (scope, method, number), scope.rows
        if key in self._bases:
            self._bases[key].shared = True
        else:
            self._bases[key] = Node(
                rows,
                "f",
                lambda: lambda s: getattr(s.generator, method)((rows, s.replicas)),
                kept=True,
            )
        return self._bases[key]

    def _choice(self, condition: Node, then: Node, other: Node) -> Node:
        kind = _promoted(then, other)
        rows = max(condition.rows, then.rows, other.rows)

        def whole(value: np.ndarray, s: Frame) -> np.ndarray:
            shape = (rows, s.replicas)
            return value if value.shape == shape else np.broadcast_to(value, shape)

        def make(c: Closure, f: Closure, g: Closure) -> Closure:
            def choice(s: Frame) -> np.ndarray:
                where = c(s)
                if where.all():
                    return whole(f(s), s)
                if not where.any():
                    return whole(g(s), s)
                x = within(s, where.any(axis=0), f) if then.checks else f(s)
                y = within(s, ~where.all(axis=0), g) if other.checks else g(s)
                return selected(where, x, y)

            return choice

        args = (condition, then, other)
        if all(arg.value is not None for arg in args):
            return _constant(np.where(*(arg.value for arg in args)), kind)  # type: ignore[arg-type]
        return self._over(args, make, rows, kind, fresh=False)

    def _switch(self, e: Any, scope: Scope) -> Node:
        predicate, *cases = e.args
        node = self.lower(predicate, scope)
        named = {self._index(case[0]): case[1] for kind, case in cases if kind == "case"}
        default = next((case for kind, case in cases if kind != "case"), None)
        count = len(self._model.type_to_objects[self._model.variable_ranges[predicate.args[0]]])
        nodes = self._branches([named.get(number, default) for number in range(count)], scope)
        node.shared, result = True, nodes[0]
        for number in range(1, count):
            is_it = self._elementwise(np.equal, "b", node, _constant(np.full((1, 1), number)))
            result = self._choice(is_it, nodes[number], result)
        return result

    # --- aggregation ---------------------------------------------------------------------

    def _aggregation(self, e: Any, scope: Scope) -> Node:
        _, op = e.etype
        if (factored := self._factored(e, scope)) is not None:
            return self.lower(factored, scope)
        *binders, body = e.args
        variables = [(name, self._count(kind)) for name, kind in typed(binders)]
        traits = self.traits(body)
        guards = [] if traits.draws or traits.raises else list(self._guards(body, op))
        inner = self._laid_out(scope, variables, guards)
        segment = inner.columns[""]
        if inner.rows == 0:
            return _constant(np.full((1, 1), IDENTITIES[op]))
        counts = np.bincount(segment, minlength=scope.rows)
        if counts.min() != counts.max():
            # segments of one length side by side
            inner = inner.taken(np.argsort(counts[segment], kind="stable"))
        node = self.lower(body, inner)
        node = self._bool(node) if op in ("exists", "forall") else node
        kind = "b" if op in ("exists", "forall") else "i" if node.kind == "b" else node.kind
        if op in ("argmin", "argmax"):
            kind = "i"
        elif op == "avg":
            kind = "f"
        if node.rows == 1 and op in ("exists", "forall", "minimum", "maximum") and counts.all():
            return node if node.kind != "b" or kind == "b" else self._number(node)
        reduce = _reduction(op, node.kind, counts)
        rows = inner.rows

        def whole(value: np.ndarray) -> np.ndarray:
            if value.shape[0] != rows:
                value = np.broadcast_to(value, (rows, value.shape[1]))
            return reduce(value)

        if node.value is not None:
            return _constant(whole(node.value), kind)
        return self._over((node,), lambda f: lambda s: whole(f(s)), scope.rows, kind)

    def _factored(self, e: Any, scope: Scope) -> Any:
        """The aggregation with one variable eliminated after the other, where that has fewer rows.

        exists_{y, z} [a(x, y) ^ b(y, z)] is exists_{y} [a(x, y) ^ exists_{z} [b(y, z)]], and the
        inner one is evaluated once for each y. The same holds for `forall` and `|`, and for sums of
        products of integers; sums of reals would be rounded otherwise.
        """
        op, (*binders, body) = e.etype[1], e.args
        if op not in _FACTORS or self.traits(body).draws or self.traits(body).raises:
            return None
        factors = _flattened(body, ("*", "^", "&") if op == "sum" else _FACTORS[op])
        if len(factors) == 1 or (op == "sum" and not all(map(self._is_whole, factors))):
            return None
        kinds = dict(typed(binders))
        sizes = {name: self._count(kind) for name, kind in kinds.items()}
        every = {**scope.sizes, **sizes}
        cost, left = 0, dict(kinds)
        while left:
            reads = {v: [f for f in factors if v in self.traits(f).free] for v in left}
            if not all(reads.values()):
                return None
            free = {v: frozenset().union(*(self.traits(f).free for f in reads[v])) for v in left}
            variable = min(left, key=lambda v: math.prod(every[name] for name in free[v]))
            kind, among = left.pop(variable), reads[variable]
            inner = self._expression(op, [("typed_var", (variable, kind)), self._joined(op, among)])
            outer, _ = scope.restricted(free[variable])
            outer = outer.extended((v, sizes[v]) for v in left if v in free[variable])
            cost += self._rows_of(inner, outer)
            factors = [f for f in factors if f not in among] + [inner]
        if 2 * cost >= self._rows_of(e, scope):
            return None
        return self._joined(op, factors)

    def _rows_of(self, e: Any, scope: Scope) -> int:
        """How many tuples an aggregation is laid out for, without conditions if those are many."""
        op, (*binders, body) = e.etype[1], e.args
        variables = [(name, self._count(kind)) for name, kind in typed(binders)]
        rows = scope.rows * math.prod(size for _, size in variables)
        if rows > _MANY_ROWS:
            return rows
        return self._laid_out(scope, variables, list(self._guards(body, op))).rows

    def _expression(self, *content: Any) -> Any:
        made = Expression(content)
        self._made.append(made)  # what is known of expressions is kept by their identity
        return made

    def _joined(self, op: str, factors: Sequence[Any]) -> Any:
        result = factors[0]
        for factor in factors[1:]:
            result = self._expression(_FACTORS[op][0], [result, factor])
        return result

    def _is_whole(self, e: Any) -> bool:
        """Whether the value is a bool or an integer, as far as the form tells."""
        kind, name = e.etype
        if kind == "pvar":
            is_fluent = not name.startswith("?") and name in self._shapes
            return not is_fluent or self.kind(name) != "f"
        if kind == "constant":
            return not isinstance(e.args, float)
        if kind == "aggregation":
            return name in ("exists", "forall") or self._is_whole(e.args[-1])
        if kind == "arithmetic":
            return name != "/" and all(map(self._is_whole, e.args))
        return kind in ("relational", "boolean")

    def _count(self, kind: str) -> int:
        return len(self._model.type_to_objects[kind])

    def _laid_out(
        self, scope: Scope, variables: Sequence[tuple[str, int]], guards: list[tuple[Any, bool]]
    ) -> Scope:
        """A scope with further variables, without tuples that a guard rules out.

        Its column "" has the number of the outer tuple of each.
        """
        columns = {name: column for name, column in scope.columns.items() if name}
        columns[""] = np.arange(scope.rows)
        inner = Scope(columns, {**scope.sizes, "": scope.rows}, scope.rows)
        pending = guards
        for variable in [None, *variables]:
            if variable is not None:
                inner = inner.extended([variable])
            bound = set(inner.columns)
            ready = [guard for guard in pending if self.traits(guard[0]).free <= bound]
            pending = [guard for guard in pending if guard not in ready]
            for condition, wanted in ready:
                value = self.lower(condition, inner).value
                assert value is not None
                keep = np.broadcast_to((value[:, 0] != 0) == wanted, inner.rows)
                if not keep.all():
                    inner = inner.taken(keep)
        return inner

    def _guards(self, e: Any, op: str, wanted: bool = True) -> Iterator[tuple[Any, bool]]:
        """Static conditions, with the truth value without which a tuple leaves no trace."""
        if op == "sum" and e.etype == ("arithmetic", "*"):
            for arg in e.args:
                yield from self._guards(arg, op)
        elif op in ("sum", "prod") and e.etype == ("control", "if"):
            condition, then, other = e.args
            if self._is(other, IDENTITIES[op]):
                yield from self._guards(condition, "exists", True)
                yield from self._guards(then, op)
            elif self._is(then, IDENTITIES[op]):
                yield from self._guards(condition, "exists", False)
                yield from self._guards(other, op)
        elif op in ("exists", "forall", "sum"):
            wanted = wanted if op == "exists" else op == "sum"
            yield from self._truths(e, wanted)

    def _truths(self, e: Any, wanted: bool) -> Iterator[tuple[Any, bool]]:
        """Static parts of a formula, each with the value that the formula's own one needs."""
        if self.traits(e).static:
            yield e, wanted
        elif e.etype[0] == "boolean":
            op, args = e.etype[1], e.args
            if op == "~" and len(args) == 1:
                yield from self._truths(args[0], not wanted)
            elif (op in ("^", "&") and wanted) or (op == "|" and not wanted):
                for arg in args:
                    yield from self._truths(arg, wanted)
            elif op == "=>" and not wanted:
                yield from self._truths(args[0], True)
                yield from self._truths(args[1], False)

    @staticmethod
    def _is(e: Any, value: float) -> bool:
        return e.is_constant_expression() and e.args == value

    # --- distributions -------------------------------------------------------------------

    def chance(self, e: Any, scope: Scope) -> Node | None:
        """How likely a bool expression is true, given all that is drawn before it.

        Read are Bernoulli and certain laws, choices between them by what is certain, and what is
        made of these by "not", "and" and "or", whose draws are independent. None for others.
        """
        if not self.traits(e).draws:
            return self._number(self.lower(e, scope))
        (kind, name), args = e.etype, e.args
        if name == "Bernoulli" and not self.traits(args[0]).draws:
            node = self._number(self.lower(args[0], scope))
            return self._elementwise(lambda p: np.clip(p, 0.0, 1.0), "f", node)
        if name == "KronDelta":
            return self.chance(args[0], scope)
        if (kind, name) == ("control", "if") and not self.traits(args[0]).draws:
            condition = self._bool(self.lower(args[0], scope))
            branches = [self.chance(branch, scope) for branch in args[1:]]
            if any(branch is None for branch in branches):
                return None
            return self._choice(condition, *branches)  # type: ignore[arg-type]
        if kind != "boolean" or name not in ("~", "^", "&", "|"):
            return None
        parts = [self.chance(arg, scope) for arg in args]
        if any(part is None for part in parts) or (name == "~" and len(parts) != 1):
            return None
        if name == "~":
            return self._elementwise(lambda p: 1.0 - p, "f", *parts)  # type: ignore[arg-type]
        if name == "|":
            return self._elementwise(
                lambda *ps: 1.0 - reduce(np.multiply, [1.0 - p for p in ps]),
                "f",
                *parts,  # type: ignore[arg-type]
            )
        return self._elementwise(lambda *ps: reduce(np.multiply, ps), "f", *parts)  # type: ignore[arg-type]

    def _randomvar(self, e: Any, scope: Scope) -> Node:
        _, name = e.etype
        if name in ("KronDelta", "DiracDelta"):
            return self.lower(e.args[0], scope)
        if name in ("Discrete", "UnnormDiscrete"):
            named = {self._index(case[0]): case[1] for _, case in e.args[1:]}
            nodes = [self.lower(named[number], scope) for number in range(len(named))]
            return self._discrete(nodes, scope, name == "UnnormDiscrete")
        if name in ("Discrete(p)", "UnnormDiscrete(p)"):
            *binders, (body,) = e.args
            ((variable, kind),) = typed(binders)
            count = self._count(kind)
            nodes = [
                self.lower(
                    body,
                    Scope(
                        {**scope.columns, variable: np.full(scope.rows, number)},
                        {**scope.sizes, variable: count},
                        scope.rows,
                    ),
                )
                for number in range(count)
            ]
            return self._discrete(nodes, scope, name == "UnnormDiscrete(p)")
        if name not in LAWS:
            raise UnsupportedError(f"the simulator does not know the distribution {name}")
        law = LAWS[name]
        nodes = [self._number(self.lower(arg, scope)) for arg in e.args]
        constants = [node.value for node in nodes]
        is_sound = all(v is not None for v in constants) and bool(np.all(law.domain(*constants)))
        rows = scope.rows

        def parameters(s: Frame, fs: Sequence[Closure]) -> list[np.ndarray]:
            values = [f(s) for f in fs]
            return values if is_sound else sound(s, values, law.domain, law.safe)

        def make(*fs: Closure) -> Closure:
            if law.base:
                *of, base = fs
                return lambda s: law.draw(base(s), *parameters(s, of))
            return lambda s: law.draw(s.generator, (rows, s.replicas), *parameters(s, fs))

        args = (*nodes, self._base(law.base, scope)) if law.base else tuple(nodes)
        return Node(rows, law.kind, make, args, checks=not is_sound or _checks(nodes))

    def _discrete(self, nodes: list[Node], scope: Scope, is_unnormalised: bool) -> Node:
        count = len(nodes)
        nodes = [self._number(node) for node in nodes]

        def bounds(weights: list[Any]) -> tuple[list[Any], Any]:
            """The cumulative probabilities, and where they are ones."""
            sums = list(accumulate(weights))
            if is_unnormalised:
                sums = [each / sums[-1] for each in sums]
            fine = sums_to_one(sums[-1])
            for weight in weights:
                fine = fine & (weight >= 0)
            return sums, fine

        constants = [node.value for node in nodes]
        known = bounds(constants) if all(each is not None for each in constants) else None
        is_sound = known is not None and bool(np.all(known[1]))
        small = np.uint8 if count < 256 else INT

        def make(uniform: Closure, *fs: Closure) -> Closure:
            def draw(s: Frame) -> np.ndarray:
                sums, fine = known or bounds([f(s) for f in fs])
                if not is_sound and not fine.all():
                    s.lose(~fine)
                drawn = uniform(s)
                passed = (drawn >= sums[0]).astype(small)
                for each in sums[1:]:
                    passed += drawn >= each
                # beyond the last sum, which may be less than 1, pyRDDLGym takes the first value
                return np.multiply(passed, passed != count, dtype=INT)

            return draw

        args = (self._base(UNIFORM, scope), *nodes)
        return Node(scope.rows, "i", make, args, checks=not is_sound or _checks(nodes))

    # --- vectors, matrices, external functions -------------------------------------------

    def _randomvector(self, e: Any, scope: Scope) -> Node:
        _, name = e.etype
        targets, args = e.args
        batch, numbers = scope.restricted(set(scope.columns) - set(targets) - {""})
        count = scope.sizes[targets[0]]
        nodes = [self._with_blanks(arg, batch) for arg in args]
        blanks = [sum(each == "_" for each in arg.args[1] or ()) for arg in args]
        if name not in _VECTORS:
            raise UnsupportedError(f"the simulator does not know the distribution {name}")
        function, rows = _VECTORS[name], batch.rows
        place = scope.columns[targets[0]] + count * (
            np.arange(scope.rows) if numbers is None else numbers
        )

        def make(*fs: Closure) -> Closure:
            def draw(s: Frame) -> np.ndarray:
                shapes = [(rows, *(count,) * each) for each in blanks]
                arrays = [
                    _replicas_first(f(s), shape, s.replicas)
                    for f, shape in zip(fs, shapes, strict=True)
                ]
                values, fine = function(s.generator, *arrays)
                if not fine.all():
                    s.lose(~fine[None])
                return values.reshape(s.replicas, -1).T[place]

            return draw

        kind = "i" if name == "Multinomial" else "f"
        return Node(scope.rows, kind, make, tuple(nodes), checks=True)

    def _with_blanks(self, arg: Any, batch: Scope) -> Node:
        """An argument f(?x, _), for each tuple and each object in place of the blanks."""
        name, arguments = arg.args
        filled, variables = [], []
        for number, each in enumerate(arguments or ()):
            if each == "_":
                kind = self._model.variable_params[name][number]
                variables.append((f"?_{number}", self._count(kind)))
            filled.append(f"?_{number}" if each == "_" else each)
        inner = batch.extended(variables)
        node = self._pvar(name, filled, inner)
        if node.rows == inner.rows:
            return node
        return self._rows(node, np.zeros(inner.rows, np.int64))

    def _pyfunc(self, e: Any, scope: Scope) -> Node:
        _, name = e.etype
        captured, args = e.args
        function = self._functions.get(name)
        if function is None:
            raise UnsupportedError(f"there is no external Python function {name}")
        batch, numbers = scope.restricted(set(scope.columns) - set(captured) - {""})
        nodes = [self._with_blanks(arg, batch) for arg in args]
        shapes = [self._blank_shape(arg) for arg in args]
        width = math.prod(scope.sizes[each] for each in captured)
        place = (np.arange(scope.rows) if numbers is None else numbers) * width
        place = place + scope.number(captured)
        rows = batch.rows

        def make(*fs: Closure) -> Closure:
            def call(s: Frame) -> np.ndarray:
                arrays = [
                    _replicas_first(f(s), (rows, *shape), s.replicas)
                    for f, shape in zip(fs, shapes, strict=True)
                ]
                values = np.zeros((s.replicas, rows, width))
                for b in range(s.replicas):
                    try:
                        output = [function(*(array[b, k] for array in arrays)) for k in range(rows)]
                        values[b] = np.reshape(np.array(output), (rows, width))
                    except Exception:  # whatever the user's function raises
                        s.lose((np.arange(s.replicas) == b)[None])
                return values.reshape(s.replicas, -1).T[place]

            return call

        return Node(scope.rows, "f", make, tuple(nodes), checks=True)

    def _blank_shape(self, arg: Any) -> tuple[int, ...]:
        name, arguments = arg.args
        kinds = self._model.variable_params[name] if arguments else []
        return tuple(
            self._count(kind)
            for each, kind in zip(arguments or (), kinds, strict=True)
            if each == "_"
        )

    def _matrix(self, e: Any, scope: Scope) -> Node:
        _, name = e.etype
        if name == "det":
            *binders, body = e.args
            variables = [(each, self._count(kind)) for each, kind in typed(binders)]
            inner, rows = scope.extended(variables), scope.rows
            place = np.arange(rows)
        else:
            pair, body = e.args
            variables = [(each, scope.sizes[each]) for each in pair]
            inner, rows = Scope().extended(variables), 1
            place = scope.number(pair)
        shape = (rows, *(size for _, size in variables))
        function = _MATRICES[name]

        def make(f: Closure) -> Closure:
            def compute(s: Frame) -> np.ndarray:
                array = _replicas_first(f(s), shape, s.replicas).astype(REAL)
                try:
                    values = function(array)
                except np.linalg.LinAlgError:
                    values = np.zeros_like(array)
                    for b in range(s.replicas):
                        try:
                            values[b] = function(array[b])
                        except np.linalg.LinAlgError:
                            s.lose((np.arange(s.replicas) == b)[None])
                return values.reshape(s.replicas, -1).T[place]

            return compute

        node = self.lower(body, inner)
        if node.rows != inner.rows:
            node = self._rows(node, np.zeros(inner.rows, np.int64))
        return Node(len(place), "f", make, (node,), checks=True)


# --- what the closures call ------------------------------------------------------------------


def within(frame: Frame, active: Any, closure: Closure) -> np.ndarray:
    """What a closure gives while these replicas alone can be lost."""
    outer = frame.active
    frame.active = active if outer is None else active & outer
    value = closure(frame)
    frame.active = outer
    return value


def sound(
    frame: Frame,
    values: list[np.ndarray],
    domain: Callable[..., Any],
    safe: tuple[float, ...],
) -> list[np.ndarray]:
    """Parameters in their domain: replicas in which they leave it are lost."""
    fine = domain(*values)
    if fine.all():
        return values
    frame.lose(~fine)
    return [np.where(fine, value, other) for value, other in zip(values, safe, strict=True)]


def _applied(
    function: Callable[..., Any], fs: Sequence[Closure], args: Sequence[Node], into: int | None
) -> Closure:
    """A function of one or two arguments; the array of argument `into` takes the result."""
    if len(fs) == 1:
        (f,) = fs
        return _into_unary(function, f) if into == 0 else lambda s: function(f(s))
    f, g = fs
    if into is not None:
        return _into_binary(function, f, g, into)
    left, right = args[0].value, args[1].value
    if left is not None:
        return lambda s: function(left, g(s))
    if right is not None:
        return lambda s: function(f(s), right)
    return lambda s: function(f(s), g(s))


def _into_unary(function: Callable[..., Any], f: Closure) -> Closure:
    def unary(s: Frame) -> np.ndarray:
        x = f(s)
        return function(x, out=x)

    return unary


def _into_binary(function: Callable[..., Any], f: Closure, g: Closure, into: int) -> Closure:
    def into_left(s: Frame) -> np.ndarray:
        x = f(s)
        return function(x, g(s), out=x)

    def into_right(s: Frame) -> np.ndarray:
        x, y = f(s), g(s)
        return function(x, y, out=y)

    return into_right if into else into_left


def selected(where: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`numpy.where` bit by bit: no branch that the processor would have to predict."""
    if x.dtype == bool and y.dtype == bool:
        return y ^ (where & (x ^ y))
    dtype = np.result_type(x, y)
    x, y = x.astype(dtype, copy=False), y.astype(dtype, copy=False)
    mask = where.astype(INT)
    np.negative(mask, out=mask)
    bits = x.view(INT) ^ y.view(INT)
    bits = bits & mask
    bits = bits ^ y.view(INT)
    return bits.view(dtype)


def _constant(value: np.ndarray, kind: str | None = None) -> Node:
    kind = kind or {"b": "b", "i": "i", "u": "i"}.get(value.dtype.kind, "f")
    return Node(len(value), kind, value=value, varies=False)


def _promoted(*nodes: Node) -> str:
    return max((node.kind for node in nodes), key="bif".index)


def _checks(nodes: Sequence[Node]) -> bool:
    return any(node.checks for node in nodes)


def _simple_first(args: Sequence[Any]) -> Sequence[Any]:
    """The operands in the order in which pyRDDLGym evaluates those that it may skip."""

    def is_simple(e: Any) -> bool:
        return e.is_constant_expression() or e.is_pvariable_expression()

    if len(args) == 2:
        return args[::-1] if is_simple(args[1]) else args
    return sorted(args, key=lambda e: not is_simple(e))


def _raises(e: Any) -> bool:
    """Whether pyRDDLGym may raise an error in this operation."""
    kind, name = e.etype
    if (kind, name) == ("func", "pow"):
        exponent = e.args[1]
        return not (exponent.is_constant_expression() and exponent.args >= 0)
    return kind == "matrix" or (kind == "func" and name in ("lngamma", "gamma"))


def _is_wild(e: Any) -> bool:
    """Whether finite operands may have a result that is not finite."""
    kind, name = e.etype
    if (kind, name) == ("arithmetic", "/"):
        return not e.args[1].is_constant_expression()
    return kind == "func" and name in _WILD


def _parts(e: Any) -> tuple[list[str], list[Any]]:
    """The variables that an expression binds, and its operands."""
    kind, name = e.etype
    if kind == "constant":
        return [], []
    if kind == "pvar":
        return [], [a for a in e.args[1] or () if not isinstance(a, str)]
    if kind == "aggregation" or (kind, name) == ("matrix", "det"):
        *binders, body = e.args
        return [variable for variable, _ in typed(binders)], [body]
    if kind == "matrix":
        return list(e.args[0]), [e.args[1]]
    if kind in ("randomvector", "pyfunc"):
        return [], list(e.args[1])
    if kind == "control" and name == "switch":
        predicate, *cases = e.args
        return [], [predicate, *(c[1] if which == "case" else c for which, c in cases)]
    if kind == "randomvar" and name in ("Discrete", "UnnormDiscrete"):
        return [], [case[1] for _, case in e.args[1:]]
    if kind == "randomvar" and name in ("Discrete(p)", "UnnormDiscrete(p)"):
        *binders, bodies = e.args
        return [variable for variable, _ in typed(binders)], list(bodies)
    return [], list(e.args)


def _flattened(e: Any, operators: tuple[str, ...]) -> list[Any]:
    if e.etype[0] in ("boolean", "arithmetic") and e.etype[1] in operators and len(e.args) > 1:
        return [factor for arg in e.args for factor in _flattened(arg, operators)]
    return [e]


def _replicas_first(value: np.ndarray, shape: tuple[int, ...], replicas: int) -> np.ndarray:
    """[K, B or 1] as [B, *shape]."""
    full = np.broadcast_to(value, (math.prod(shape), replicas))
    return np.moveaxis(full.reshape(*shape, replicas), -1, 0)


def _reduced(function: Any, value: np.ndarray) -> np.ndarray:
    """Reduces axis 1 in order: many short segments term by term, which is what numpy is slow at."""
    count = value.shape[1]
    if count == 1 or count > value.shape[0]:
        return function.reduce(value, axis=1, dtype=value.dtype)
    result = function(value[:, 0], value[:, 1])
    for number in range(2, count):
        function(result, value[:, number], out=result)
    return result


def _added(value: np.ndarray) -> np.ndarray:
    """The sums [K, B] over the middle axis of [K, n, B], as numpy adds up n contiguous numbers."""
    count = value.shape[1]
    if count < _LANES:
        return _reduced(np.add, value)
    if count > _BLOCK:
        half = count // 2 - count // 2 % _LANES
        return _added(value[:, :half]) + _added(value[:, half:])
    blocks = count // _LANES
    rows, columns = value.shape[0], value.shape[2]
    lanes = value[:, : blocks * _LANES].reshape(rows, blocks, _LANES, columns)
    r = _reduced(np.add, lanes)
    total = ((r[:, 0] + r[:, 1]) + (r[:, 2] + r[:, 3])) + (
        (r[:, 4] + r[:, 5]) + (r[:, 6] + r[:, 7])
    )
    for number in range(blocks * _LANES, count):
        total += value[:, number]
    return total


def _reduction(op: str, kind: str, counts: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Reduces rows in segments of these lengths [K], shorter segments first."""
    reduce = _middle(op, kind, int(counts.max()))
    if counts.min() == counts.max():
        rows, count = len(counts), int(counts[0])
        return lambda value: reduce(value.reshape(rows, count, value.shape[1]))
    groups, start = [], 0
    for length in np.unique(counts):
        where = np.flatnonzero(counts == length)
        if length:
            groups.append((start, start + len(where) * length, int(length), where))
            start += len(where) * length
    identity, rows = IDENTITIES.get(op), len(counts)
    has_empty = bool((counts == 0).any())

    def reduced(value: np.ndarray) -> np.ndarray:
        result = None
        for first, last, length, where in groups:
            part = reduce(value[first:last].reshape(len(where), length, value.shape[1]))
            if result is None:
                result = np.empty((rows, value.shape[1]), part.dtype)
                if has_empty:
                    result[...] = identity
            result[where] = part
        assert result is not None
        return result

    return reduced


def _middle(op: str, kind: str, longest: int) -> Callable[[np.ndarray], np.ndarray]:
    """Reduces the middle axis of [K, n, B]."""
    if op == "sum" and kind == "b":
        if longest < 256:
            return lambda v: _reduced(np.add, v.view(np.uint8)).astype(INT)
        return lambda v: np.add.reduce(v, axis=1, dtype=INT)
    if op == "sum" and kind == "f":
        return _added
    if op in AGGREGATIONS:
        function = AGGREGATIONS[op]
        if kind == "b" and op not in ("exists", "forall"):
            return lambda v: _reduced(function, v.astype(INT))
        return lambda v: _reduced(function, v)
    if op == "avg":
        return lambda v: (_added(v) if kind == "f" else v.sum(axis=1, dtype=REAL)) / v.shape[1]
    if op == "argmin":
        return lambda v: np.argmin(v, axis=1)
    if op == "argmax":
        return lambda v: np.argmax(v, axis=1)
    raise UnsupportedError(f"the simulator does not know the aggregation {op}")


def _cholesky(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The factors, and which replicas have one."""
    fine = np.ones(len(covariance), bool)
    try:
        return np.linalg.cholesky(covariance), fine
    except np.linalg.LinAlgError:
        factors = np.zeros_like(covariance)
        for b, each in enumerate(covariance):
            try:
                factors[b] = np.linalg.cholesky(each)
            except np.linalg.LinAlgError:
                fine[b] = False
        return factors, fine


def _replica(mask: np.ndarray) -> Any:
    return mask.reshape(len(mask), -1).all(axis=1)


def _multivariate_normal(g: Any, mean: Any, covariance: Any) -> tuple[np.ndarray, np.ndarray]:
    factor, fine = _cholesky(covariance)
    z = g.standard_normal((*mean.shape, 1))
    return np.matmul(factor, z)[..., 0] + mean, fine


def _multivariate_student(
    g: Any, mean: Any, covariance: Any, df: Any
) -> tuple[np.ndarray, np.ndarray]:
    factor, fine = _cholesky(covariance)
    good = df > 0
    z = g.standard_t(np.broadcast_to(np.where(good, df, 1.0)[..., None, None], (*mean.shape, 1)))
    return np.matmul(factor, z)[..., 0] + mean, fine & _replica(good)


def _dirichlet(g: Any, alpha: Any) -> tuple[np.ndarray, np.ndarray]:
    good = alpha > 0
    draws = g.standard_gamma(np.where(good, alpha, 1.0))
    return draws / draws.sum(axis=-1, keepdims=True), _replica(good)


def _multinomial(g: Any, trials: Any, weights: Any) -> tuple[np.ndarray, np.ndarray]:
    good = (trials >= 0) & (weights >= 0).all(axis=-1) & sums_to_one(weights.sum(axis=-1))
    even = np.full(weights.shape[-1], 1.0 / weights.shape[-1])
    pvals = np.where(good[..., None], weights, even)
    return g.multinomial(np.where(good, trials, 0), pvals), _replica(good)


_VECTORS: Mapping[str, Callable[..., tuple[np.ndarray, np.ndarray]]] = {
    "MultivariateNormal": _multivariate_normal,
    "MultivariateStudent": _multivariate_student,
    "Dirichlet": _dirichlet,
    "Multinomial": _multinomial,
}
_MATRICES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "det": np.linalg.det,
    "inverse": np.linalg.inv,
    "pinverse": np.linalg.pinv,
    "cholesky": np.linalg.cholesky,
}
