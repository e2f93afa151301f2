"""Replacing few of many leaves gives the nodes that replacing all of them gives."""

import numpy as np
import pytest

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.substitution import Substitution

LEAVES, NODES = 6, 60


def random_nodes(graph, generator):
    """Leaves that are actions, and nodes over these and a few that are none."""
    actions = [graph.leaf(Kind.ACTION, ("a", number), True) for number in range(LEAVES)]
    nodes = actions + [graph.leaf(Kind.STATE, ("s", number), True) for number in range(3)]
    for _ in range(NODES):
        operator = ("and", "or", "not", "if")[generator.integers(4)]
        count = {"not": 1, "if": 3}.get(operator, 2)
        nodes.append(graph.make(operator, *(generator.choice(nodes, size=count).tolist())))
    return actions, nodes


@pytest.mark.parametrize("seed", range(5))
def test_it_gives_what_a_whole_substitution_gives(seed):
    generator, graph = np.random.default_rng(seed), Graph()
    actions, nodes = random_nodes(graph, generator)
    usual = dict.fromkeys(actions, graph.false)
    played = Substitution(graph, nodes, usual)
    assert played(usual) == graph.substitute(nodes, usual)
    for _ in range(20):
        values = {leaf: graph.true if generator.random() < 0.3 else graph.false for leaf in actions}
        assert played(values) == graph.substitute(nodes, values)


def test_what_a_change_does_not_lead_to_is_not_made_again(monkeypatch):
    graph = Graph()
    actions = [graph.leaf(Kind.ACTION, ("a", number), True) for number in range(2)]
    states = [graph.leaf(Kind.STATE, ("s", number), True) for number in range(2)]
    nodes = [graph.make("and", *pair) for pair in zip(actions, states, strict=True)]
    played = Substitution(graph, nodes, dict.fromkeys(actions, graph.false))
    made, make = [], graph.make
    monkeypatch.setattr(graph, "make", lambda *given: made.append(given) or make(*given))
    given = {actions[0]: graph.true, actions[1]: graph.false}
    assert played(given) == [states[0], graph.false]
    assert made == [("and", *sorted((graph.true, states[0])))]
    # of those that are wanted
    assert played(given, [1]) == [graph.false]
