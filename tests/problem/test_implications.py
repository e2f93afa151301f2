"""Preconditions that forbid single bools, read from the RDDL."""

import pytest

from mdpo_rddl.problem.implications import read_rules
from mdpo_rddl.problem.load import load_problem

DOMAIN = """
domain docks {
    types { truck : object; city : object; };
    pvariables {
        NEAR(truck, city) : { non-fluent, bool, default = false };
        MOST(truck) : { non-fluent, real, default = 1.0 };
        open(city) : { state-fluent, bool, default = true };
        dock(truck, city) : { action-fluent, bool, default = false };
        wait : { action-fluent, bool, default = false };
        ROPE(truck, truck) : { non-fluent, real, default = 1.0 };
        push(truck) : { action-fluent, real, default = 0.0 };
        tow(truck, truck) : { action-fluent, real, default = 0.0 };
    };
    cpfs { open'(?c) = open(?c); };
    reward = sum_{?t : truck} [push(?t)];
    action-preconditions { RULE; };
}
"""
INSTANCE = """
non-fluents nf { domain = docks; objects { truck : {s, t, u}; city : {a, b}; }; }
instance one {
    domain = docks; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 3; discount = 1.0;
}
"""


def rules(folder, rule):
    (folder / "d.rddl").write_text(DOMAIN.replace("RULE", rule))
    (folder / "i.rddl").write_text(INSTANCE)
    return read_rules(load_problem(str(folder / "d.rddl"), str(folder / "i.rddl")).model)


@pytest.mark.parametrize(
    ("rule", "axes", "sizes", "given"),
    [
        ("forall_{?t : truck, ?c : city} [dock(?t, ?c) => open(?c)]", (0, 1), (3, 2), 0),
        ("forall_{?c : city} [forall_{?t : truck} [dock(?t, ?c) => open(?c)]]", (1, 0), (2, 3), 0),
        (
            "forall_{?t : truck, ?c : city} [dock(?t, ?c) ^ open(?c) => NEAR(?t, ?c)]",
            (0, 1),
            (3, 2),
            1,
        ),
    ],
)
def test_an_implication_on_single_bools(tmp_path, rule, axes, sizes, given):
    found = rules(tmp_path, rule)
    assert found.others == ()
    (one,) = found.implications
    assert (one.action, one.axes, one.sizes, len(one.given)) == ("dock", axes, sizes, given)


def test_a_conjunction_has_several(tmp_path):
    both = "forall_{?t : truck, ?c : city} [(dock(?t, ?c) => open(?c)) ^ (wait => NEAR(?t, ?c))]"
    found = rules(tmp_path, both)
    assert [(one.action, one.axes) for one in found.implications] == [
        ("dock", (0, 1)),
        ("wait", ()),
    ]


@pytest.mark.parametrize(
    "rule",
    [
        # another action on the right
        "forall_{?t : truck, ?c : city} [dock(?t, ?c) => ~wait]",
        # two actions on the left
        "forall_{?t : truck, ?c : city} [dock(?t, ?c) ^ wait => open(?c)]",
        # under an exists
        "exists_{?t : truck, ?c : city} [dock(?t, ?c) => open(?c)]",
        "forall_{?t : truck} [push(?t) <= sum_{?c : city} [open(?c)]]",
        # pyRDDLGym makes no box of "&", and of one truck in two places there is none
        "forall_{?t : truck} [(push(?t) >= 0.0) & (push(?t) <= 1.0)]",
        "forall_{?t : truck} [tow(?t, ?t) <= ROPE(?t, ?t)]",
    ],
)
def test_what_is_neither_a_box_nor_an_implication(tmp_path, rule):
    found = rules(tmp_path, rule)
    assert (found.implications, found.others) == ((), (0,))


@pytest.mark.parametrize(
    "rule",
    [
        "forall_{?t : truck} [push(?t) <= MOST(?t)]",
        "forall_{?t : truck} [(push(?t) >= 0.0) ^ (MOST(?t) >= push(?t))]",
        "forall_{?t : truck, ?u : truck} [tow(?t, ?u) <= MOST(?t) * ROPE(?u, ?t)]",
        "forall_{?u : truck, ?t : truck} [tow(?t, ?u) <= 2.0]",
        "forall_{?u : truck, ?t : truck} [tow(?t, ?u) <= ROPE(?u, ?t)]",
        "exists_{?c : city} [open(?c)]",
    ],
)
def test_boxes_and_what_names_no_action_ask_nothing(tmp_path, rule):
    found = rules(tmp_path, rule)
    assert (found.implications, found.others) == ((), ())
