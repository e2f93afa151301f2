"""Fluents at the objects that the state names, as a policy reads them."""

import jax
import numpy as np
import pytest
from helpers.toys import toy
from helpers.vans import vans

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.plans.lookups import Lookups, lookups

STATE = {
    "clock": np.array(1),
    "at": np.array([2, 0]),
    "waits": np.array([4, 5, 6]),
    # as in a relaxed model
    "open": np.array([0.9, 0.1, 0.1]),
}
NAMES = {
    "LOAD(clock)": 9.0,
    "SAME(clock)": 1.0,
    "waits(at(?van))": [6, 4],
    "open(at(?van))": [0.1, 0.9],
    "LIMIT(at(?van), ?van)": [7, 3],
}


def planner_of(problem, **arguments):
    config = auto_preset("lookups").without_section("Search")
    config = config.with_policy_arguments(topology=[], squares=False, plan=False, **arguments)
    return build_planner(problem, config).planner


@pytest.fixture(scope="module")
def compiled():
    return planner_of(vans()).compiled


def test_what_is_looked_up_is_found_by_types(compiled):
    # neither an hour, as AFTER(clock), nor a relation of places
    assert set(lookups(compiled.rddl)) == set(NAMES)


def test_nothing_is_looked_up_where_no_fluent_names_objects():
    assert lookups(toy("drift").model) == {}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("compiles", [lambda look: look, jax.jit])
def test_each_has_its_value_in_a_state(compiled, name, compiles):
    found = Lookups(compiled.rddl, compiled.init_values, [name])
    value = compiles(found)(STATE)[name]
    np.testing.assert_allclose(value, NAMES[name])
    assert value.shape == found.shapes[name] == ((2,) if "van" in name else ())
    assert found.types[name] == (["van"] if "van" in name else [])


def test_numbers_of_objects_may_be_relaxed(compiled):
    found = Lookups(compiled.rddl, compiled.init_values, ["waits(at(?van))"])
    near = {**STATE, "at": np.array([1.6, -0.2])}
    np.testing.assert_array_equal(found(near)["waits(at(?van))"], [6, 4])


def test_other_names_are_refused(compiled):
    with pytest.raises(ValueError, match="lookups: there is no 'LOAD' in this problem"):
        Lookups(compiled.rddl, compiled.init_values, ["LOAD(clock)", "LOAD"])


def test_a_policy_reads_them_as_it_reads_the_state():
    scales = {"LOAD(clock)": [5.0, 2.0]}
    planner = planner_of(vans(), lookups=["LOAD(clock)", "waits(at(?van))"], state_scales=scales)
    plan = planner.feedback_plan
    feedback, params = plan.feedback, plan.noop(0)
    assert feedback.seen == ["clock", "at", "waits", "open"]
    shared = {name: np.zeros(len(feedback.names(name))) for name in ("go", "pump")}
    shared["pump"][feedback.names("pump").index("LOAD(clock)")] = 1.0
    shared["go"][feedback.names("go").index("waits(at(?van))")] = 0.5
    raw = feedback.raw({**params, "shared": shared}, STATE, 0)
    assert float(raw["pump"]) == pytest.approx(2.0)
    np.testing.assert_allclose(raw["go"], [3.0, 2.0])
    # each object may have a gain of its own on them
    assert "gain on waits(at(?van))" in params["own"]["go"]
    assert feedback.flat(STATE).shape == (9 + 1 + 2,)


def test_gains_of_pairs_are_for_what_is_given():
    # of the pump and the nine numbers of the state
    own = planner_of(vans(), lookups=["LOAD(clock)"], pairs=9).feedback_plan.noop(0)["own"]["pump"]
    assert {name for name in own if "pairs" in name} == {
        f"gains of pairs on {fluent}" for fluent in ("at", "waits", "open")
    }


def test_a_scale_of_something_else_is_refused():
    with pytest.raises(InputError, match="state_scales: there is no fluent 'LOAD"):
        planner_of(vans(), state_scales={"LOAD(clock)": [0.0, 1.0]})


@pytest.mark.parametrize("names", ["LOAD(clock)", [1], 2])
def test_names_must_be_a_list_of_words(names):
    with pytest.raises(InputError, match="lookups: must be a list of names"):
        planner_of(vans(), lookups=names)


def test_a_configuration_keeps_them():
    config = auto_preset("lookups").with_policy_arguments(lookups=["LOAD(clock)"])
    again = PlannerConfig.from_text(config.to_text())
    assert again.policy_arguments["lookups"] == ["LOAD(clock)"]
