"""Fluents' values side by side in one vector."""

from mdpo_rddl.planner.plans.places import places_of


def test_each_fluent_has_its_part_in_their_order():
    shapes = {"b": (2, 3), "a": (), "none": (0,), "c": (4,)}
    assert places_of(shapes) == {
        "b": slice(0, 6),
        "a": slice(6, 7),
        "none": slice(7, 7),
        "c": slice(7, 11),
    }
    assert places_of({}) == {}
