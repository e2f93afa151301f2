"""Ground expressions: the graph, the laws of random ones, expectations, packed states."""

from itertools import product

import numpy as np
import pytest

from mdpo_rddl.problem.enumeration.expectation import expectation
from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.laws import Laws
from mdpo_rddl.problem.enumeration.packing import keys, pack, sizes_of
from mdpo_rddl.problem.enumeration.program import Program


def value(graph, node, **leaves):
    columns = {
        graph.leaf(Kind.STATE, name, isinstance(each, bool)): np.array([each])
        for name, each in leaves.items()
    }
    return np.ravel(Program(graph, [node]).run(columns)[node])[0]


@pytest.fixture
def graph():
    return Graph()


@pytest.fixture
def bools(graph):
    return [graph.leaf(Kind.STATE, name, True) for name in "abc"]


def test_equal_expressions_are_one_node(graph, bools):
    a, b, _ = bools
    assert graph.make("and", a, b) == graph.make("and", b, a, a, graph.true)
    assert graph.make("if", a, graph.true, graph.false) == a
    assert graph.make("not", graph.make("not", a)) == a
    assert graph.make("+", a, graph.constant(1), graph.constant(2)) == graph.make(
        "+", graph.constant(3), a
    )
    assert graph.constant(1) != graph.constant(True) != graph.constant(1.0)


@pytest.mark.parametrize("yes", ["true", "false", "b", "number"])
@pytest.mark.parametrize("no", ["true", "false", "c", "number"])
def test_simplified_choices_have_the_values_of_choices(graph, bools, yes, no):
    known = {"true": graph.true, "false": graph.false, "b": bools[1], "c": bools[2]}
    known["number"] = graph.constant(0.25)
    node = graph.make("if", bools[0], known[yes], known[no])
    for a, b, c in product((True, False), repeat=3):
        plain = {"true": True, "false": False, "b": b, "c": c, "number": 0.25}
        assert value(graph, node, a=a, b=b, c=c) == (plain[yes] if a else plain[no])


def test_substitution_folds(graph, bools):
    a, b, c = bools
    node = graph.make("or", graph.make("and", a, b), c)
    assert graph.substitute([node], {a: graph.false}) == [c]
    assert graph.substitute([node, b], {c: graph.true}) == [graph.true, b]


def test_laws_of_random_bools(graph, bools):
    laws = Laws(graph)
    half, quarter = (laws.bernoulli(graph.constant(each)) for each in (0.5, 0.25))
    assert value(graph, laws.truth(laws.apply("and", [half, quarter]))) == 0.125
    assert value(graph, laws.truth(laws.apply("or", [half, quarter]))) == 0.625
    assert value(graph, laws.truth(laws.apply("xor", [half, quarter]))) == 0.5
    sure = laws.certain(bools[0])
    chosen = laws.truth(laws.choose(sure, half, quarter))
    assert [value(graph, chosen, a=a) for a in (True, False)] == [0.5, 0.25]
    counted = laws.apply("+", [half, half, half])
    found = {graph.values[each.value]: graph.values[each.probability] for each in counted}
    assert found == {0: 0.125, 1: 0.375, 2: 0.375, 3: 0.125}


def test_an_expectation_over_next_states(graph, bools):
    # E[2 X + 3 X Y] with P(X) = 0.5, P(Y) = 0.25
    laws = Laws(graph)
    x, y = (graph.leaf(Kind.DRAWN, name, True) for name in "xy")
    drawn = {
        x: laws.bernoulli(graph.constant(0.5)),
        y: laws.bernoulli(graph.constant(0.25)),
    }
    both = graph.make("*", graph.constant(3), graph.make("and", x, y))
    node = graph.make("+", graph.make("*", graph.constant(2), x), both)
    assert value(graph, expectation(graph, node, drawn)) == 1.0 + 3 * 0.125
    square = graph.make("pow", graph.make("+", x, y), graph.constant(2))
    assert value(graph, expectation(graph, square, drawn)) == 0.5 * 0.75 + 0.5 * 0.25 + 4 * 0.125


def test_packed_states_are_read_back():
    sizes = sizes_of(["bool", "int", "color"] * 12, {"color": ["red", "green", "blue"]})
    packing = pack(sizes)
    assert packing.words > 1
    rng = np.random.default_rng(0)
    values = [
        int(rng.integers(-1000, 1000)) if size is None else int(rng.integers(size))
        for size in sizes
    ]
    state = packing.encode_all(values)[np.newaxis]
    assert [int(packing.decode(number, state)[0]) for number in range(len(values))] == values
    with pytest.raises(OverflowError):
        packing.encode(1, np.array([40_000]))
    with pytest.raises(OverflowError):
        packing.encode(2, np.array([4]))


def test_keys_of_neighbouring_states_differ():
    # all pairs of one bit in each of two words
    bits = np.uint64(1) << np.arange(64, dtype=np.uint64)
    states = np.array([[one, other] for one in bits for other in bits])
    assert len(np.unique(keys(states))) == len(states)
