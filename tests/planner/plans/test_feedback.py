"""The feedback policy as a function: its parts add up, and its gradient is cut where it says."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_planner, shipped
from helpers.toys import toy

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Feedback
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape

KEY = jax.random.PRNGKey(0)
HORIZON = 40
SHAPE = FeedbackShape(
    topology=(5,),
    cosines=2,
    plan=True,
    squares=True,
    state_scales={"rlevel": (100.0, 50.0)},
    cut_feedback=True,
)


def make(shape: FeedbackShape = SHAPE) -> Feedback:
    model = shipped("reservoir15", 3).model
    count = len(model.type_to_objects["reservoir"])
    values = {
        name: np.reshape(value, [count] * len(model.variable_params[name]))
        for name, value in {
            **model.non_fluents,
            **model.state_fluents,
            **model.action_fluents,
        }.items()
    }
    return Feedback(model, values, shape, HORIZON, jnp.float32, jnp)


@pytest.fixture(scope="module")
def feedback() -> Feedback:
    return make()


def level(value: float = 175.0) -> dict[str, np.ndarray]:
    return {"rlevel": np.full(15, value, np.float32)}


def test_the_initial_policy_does_nothing(feedback):
    raw = feedback.raw(feedback.initial(KEY), level(), 20)
    np.testing.assert_array_equal(raw["release"], np.zeros(15))


def test_names_and_weights_go_together(feedback):
    names = feedback.names("release")
    assert names[:2] == ["1", "rlevel"]
    assert names[-2:] == ["cos(1 pi t / H)", "cos(2 pi t / H)"]
    assert "rlevel^2" in names
    assert "MIN_LEVEL" in names
    assert feedback.initial(KEY)["shared"]["release"].shape == (len(names),)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("1", 1.0),
        ("rlevel", 1.5),
        ("rlevel^2", 1.5**2 - 1.0),
        ("cos(1 pi t / H)", np.cos(np.pi * 0.25)),
    ],
)
def test_a_shared_weight_is_felt_by_every_object(feedback, name, expected):
    params = feedback.initial(KEY)
    index = feedback.names("release").index(name)
    params["shared"]["release"] = params["shared"]["release"].at[index].set(2.0)
    raw = feedback.raw(params, level(), 10)
    np.testing.assert_allclose(raw["release"], np.full(15, 2.0 * expected), rtol=1e-5)


def test_own_weights_are_one_objects(feedback):
    params = feedback.initial(KEY)
    own = params["own"]["release"]
    own["bias"] = own["bias"].at[3].set(0.5)
    own["gain on rlevel"] = own["gain on rlevel"].at[4].set(2.0)
    raw = np.asarray(feedback.raw(params, level(), 0)["release"])
    assert raw[3] == 0.5
    assert raw[4] == 3.0
    assert np.count_nonzero(raw) == 2


@pytest.mark.parametrize("few", [0, 225])
def test_gains_of_pairs_are_felt_by_one_action_of_one_fluent(monkeypatch, few):
    monkeypatch.setattr("mdpo_rddl.planner.plans.feedback._FEW_PAIRS", few)
    paired = make(dataclasses.replace(SHAPE, pairs=225))
    params = paired.initial(KEY)
    gains = params["own"]["release"]["gains of pairs on rlevel"]
    assert gains.shape == (15, 15)
    params["own"]["release"]["gains of pairs on rlevel"] = gains.at[3, 4].set(2.0)
    state = level()
    state["rlevel"][4] = 150.0
    raw = np.asarray(paired.raw(params, state, 0)["release"])
    assert raw[3] == 2.0
    assert np.count_nonzero(raw) == 1


def test_there_are_gains_of_pairs_only_where_these_are_few(feedback):
    fewer = make(dataclasses.replace(SHAPE, pairs=224))
    jax.tree.map(np.testing.assert_array_equal, fewer.initial(KEY), feedback.initial(KEY))


def test_bools_have_no_gains_of_pairs():
    # its actions are a real, an integer and a bool
    planner = make_planner(MDPOPlanner, toy("drift"), FeedbackPlan(FeedbackShape(pairs=100)))
    ranges, own = planner.rddl.variable_ranges, planner.feedback_plan.noop(0)["own"]
    paired = {name for name, entries in own.items() if any("pairs" in key for key in entries)}
    assert paired == {name for name in own if ranges[name] in ("real", "int")}
    assert {ranges[name] for name in set(own) - paired} == {"bool"}


@pytest.mark.parametrize("name", ["lifted", "pairs"])
@pytest.mark.parametrize("count", [-1, 2.0, True, 10**6])
def test_a_wrong_count_is_named(name, count):
    with pytest.raises(ValueError, match=f"{name}: must be a whole number from 0 to"):
        FeedbackShape(**{name: count})


def test_the_net_sees_the_whole_state(feedback):
    params = feedback.initial(KEY)
    params["net"]["output_release"] = jnp.ones((5, 15))
    low = level(175.0)
    high = {"rlevel": low["rlevel"].copy()}
    high["rlevel"][7] = 150.0
    one, other = (np.asarray(feedback.raw(params, s, 0)["release"]) for s in (low, high))
    assert np.all(one != other)


def test_the_hidden_layer_on_each_objects_features_is_shared():
    plain, deep = make(), make(dataclasses.replace(SHAPE, lifted=2))
    params, names = deep.initial(KEY), deep.names("release")
    # as long as nothing is learnt all else is as without it
    silent = {name: part for name, part in params.items() if name != "lifted"}
    jax.tree.map(np.testing.assert_array_equal, silent, plain.initial(KEY))
    assert np.any(params["lifted"]["release"]["hidden"])
    np.testing.assert_array_equal(deep.raw(params, level(), 20)["release"], np.zeros(15))
    # tanh(1 + 2 z) and 3 tanh(-z), z being an object's level in its scale
    hidden = np.zeros((len(names), 2))
    hidden[names.index("1")] = [1.0, 0.0]
    hidden[names.index("rlevel")] = [2.0, -1.0]
    layer = {"hidden": jnp.asarray(hidden), "output": jnp.array([1.0, 3.0])}
    levels = np.linspace(50.0, 150.0, 15, dtype=np.float32)
    z = (levels - 100.0) / 50.0
    raw = deep.raw({**params, "lifted": {"release": layer}}, {"rlevel": levels}, 20)["release"]
    np.testing.assert_allclose(raw, np.tanh(1.0 + 2.0 * z) + 3.0 * np.tanh(-z), rtol=1e-5)


def test_states_far_away_are_cut_off(feedback):
    params = feedback.initial(KEY)
    params["shared"]["release"] = params["shared"]["release"].at[1].set(1.0)
    np.testing.assert_array_equal(feedback.raw(params, level(1e9), 0)["release"], 10.0)


@pytest.mark.parametrize("cut", [True, False])
def test_the_gradient_through_the_state_is_cut_if_asked(cut):
    linear = dataclasses.replace(
        SHAPE, topology=(), cosines=0, plan=False, squares=False, state_scales={}, cut_feedback=cut
    )
    feedback = make(linear)
    params = feedback.initial(KEY)
    assert "net" not in params
    params["shared"]["release"] = params["shared"]["release"].at[1].set(1.0)

    def total(value):
        return jnp.sum(feedback.raw(params, {"rlevel": value}, 0)["release"])

    gradient = jax.grad(total)(jnp.ones(15))
    np.testing.assert_array_equal(gradient, np.zeros(15) if cut else np.ones(15))


def test_a_plan_is_played_at_its_steps(feedback):
    params = feedback.initial(KEY)
    assert params["plan"]["release"].shape == (HORIZON, 15)
    params["plan"]["release"] = params["plan"]["release"].at[7, 3].set(0.5)
    for step, expected in ((6, 0.0), (7, 0.5), (8, 0.0)):
        raw = np.asarray(feedback.raw(params, level(), step)["release"])
        assert raw[3] == expected
        assert np.count_nonzero(raw) == (expected != 0.0)
