"""Which arms that must compile take part."""

from types import SimpleNamespace

import numpy as np
import pytest

from mdpo_rddl.auto.race.entrants import Entrants
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.programs.quick import Jit, light_jit


class Generous:
    """There is time for everything but what is named."""

    batch_seconds = 7.0

    def __init__(self, *refused: str) -> None:
        """Refuses these."""
        self.refused = refused

    def value(self, share: float, in_turn: int = 0, later: float = 0.0) -> bool:
        return "greedy" not in self.refused and in_turn < 30 and later < 10.0

    def value_jit(self) -> Jit:
        return light_jit

    def gradient(self, name: str, until: float, comes_first: bool = False) -> bool:
        return name not in self.refused

    def usual_seconds(self, name: str) -> float:
        return 3.0


def entrants(
    *refused,
    without=(),
    deterministic=True,
    kind="real",
    seen=(),
    memory=(),
    bools=(2, 3),
    state=9,
    values=5,
    loses=False,
    state_kind="bool",
):
    noop = {"a": np.zeros(bools), "b": np.zeros(()), "s": np.zeros(state, bool)}
    kinds = {"a": kind, "b": kind, "s": state_kind}
    rddl = SimpleNamespace(
        action_fluents=["a", "b"], variable_ranges=kinds, observ_fluents=seen, state_fluents=["s"]
    )
    boxes = dict.fromkeys("ab", (np.zeros(()), np.array(values - 1.0)))
    exact = SimpleNamespace(
        rddl=rddl, init_values=noop, constraints=SimpleNamespace(bounds=boxes), INT=np.int32
    )
    arena = SimpleNamespace(
        clock=lambda: 0.0,
        seed=0,
        incumbent=None,
        planner=SimpleNamespace(rddl=rddl, test_compiled=exact, horizon=40, lose_on_error=loses),
        config=auto_preset(""),
        plan=SimpleNamespace(memory=SimpleNamespace(initial=memory)),
        probe=SimpleNamespace(deterministic=deterministic),
    )
    return Entrants(arena, Generous(*refused), without)


def test_those_that_are_left_out_or_take_part_already_do_not_come_again():
    arm = entrants().gradient(60.0)
    assert (arm.name, arm.usual_seconds) == ("gradient", 3.0)
    assert entrants().gradient(60.0, [SimpleNamespace(name="gradient")]) is None
    assert entrants(without=["gradient"]).gradient(60.0) is None


def test_what_takes_too_long_is_left_out_and_the_gradient_is_missed(caplog):
    assert entrants("gradient").gradient(60.0, warns=False) is None
    assert caplog.text == ""
    assert entrants("gradient").gradient(60.0) is None
    assert "too little time for the gradient: 60 s" in caplog.text


@pytest.mark.parametrize(
    ("case", "comes"),
    [
        ({}, True),
        ({"deterministic": False}, False),
        ({"kind": "bool"}, False),
        ({"without": ["shooting"]}, False),
    ],
)
def test_plans_come_first_where_nothing_returns_more(case, comes):
    arm = entrants(**case).straight_line(60.0)
    assert (arm is not None) == comes
    assert arm is None or (arm.name, arm.usual_seconds) == ("shooting", 3.0)
    assert entrants("shooting", **case).straight_line(60.0) is None


def test_what_sees_the_states_has_no_prospect_where_the_best_plan_leads():
    assert not entrants().has_rival(SimpleNamespace(arm="shooting"))
    assert entrants().has_rival(SimpleNamespace(arm="plan"))


@pytest.mark.parametrize(
    ("case", "comes"),
    [
        ({"kind": "bool"}, True),
        ({"kind": "bool", "bools": (5, 51)}, True),
        ({"kind": "bool", "bools": (16, 16)}, False),
        ({"kind": "bool", "state": 7000}, False),
        # 28 changes in turn there is time for, and not 35
        ({"kind": "int", "deterministic": False}, True),
        ({"kind": "int", "deterministic": False, "values": 6}, False),
        # no policy returns more than the best plan
        ({"kind": "int"}, False),
        ({"kind": "int", "deterministic": False, "values": np.inf}, False),
        # 7 components, of 37 other values each
        ({"kind": "int", "deterministic": False, "values": 38}, False),
        ({"kind": "real"}, False),
        ({"kind": "bool", "seen": ["noise"]}, False),
        ({"kind": "bool", "without": ["greedy"]}, False),
        ({"kind": "bool", "loses": True}, False),  # what it learns from does not tell errors
    ],
)
def test_few_changes_are_tried_one_by_one_where_the_state_is_seen(case, comes):
    found = entrants(**case)
    arm = found.greedy(60.0, 0.5)
    assert (arm is not None) == comes
    assert arm is None or (arm.name, arm._batch_seconds) == ("greedy", 7.0)


def test_it_may_come_too_late():
    found = entrants(kind="bool")
    assert found.may_be_greedy(0.5, later=9.0)
    assert not found.may_be_greedy(0.5, later=11.0)


@pytest.mark.parametrize(("kind", "decides"), [("bool", False), ("int", True), ("real", True)])
def test_it_is_known_whether_numbers_are_decided(kind, decides):
    assert entrants(kind=kind).decides_numbers == decides


@pytest.mark.parametrize(
    ("kind", "state_kind", "expected"),
    [
        ("bool", "bool", False),
        ("bool", "room", False),
        ("int", "bool", True),
        ("bool", "int", True),
        ("bool", "real", True),
    ],
)
def test_there_are_numbers_among_actions_or_states(kind, state_kind, expected):
    assert entrants(kind=kind, state_kind=state_kind).has_numbers == expected


def test_what_has_no_time_to_be_compiled_does_not_learn():
    assert entrants("greedy", kind="bool").greedy(60.0, 0.5) is None
