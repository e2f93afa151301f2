"""A rule on another instance: the same actions where it fits, and word of what does not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_planner
from helpers.toys import problem_from

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.policy.transfer import transferred

DOMAIN = """
domain pushing {
    types { item : object; };
    pvariables {
        WEIGHT(item) : { non-fluent, real, default = 1.0 };
        NEXT(item, item) : { non-fluent, bool, default = false };
        x(item) : { state-fluent, real, default = 1.0 };
        push(item) : { action-fluent, real, default = 0.0 };
    };
    cpfs { x'(?i) = x(?i) + push(?i); };
    reward = -(sum_{?i : item} [x(?i) * WEIGHT(?i)]);
}
"""
INSTANCE = """
non-fluents nf {
    domain = pushing; objects { item : {OBJECTS}; }; non-fluents { VALUES };
}
instance one {
    domain = pushing; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 4; discount = 1.0;
}
"""
TWO = ("a, b", "WEIGHT(b) = 2.0; NEXT(a, b); NEXT(b, a);")
THREE = ("a, b, c", "WEIGHT(b) = 5.0; NEXT(a, b); NEXT(b, c); NEXT(c, a);")
RNG = np.random.default_rng(0)


def planner(instance, units=2.0, scale=(2.0, 4.0), **shape):
    text = INSTANCE.replace("OBJECTS", instance[0]).replace("VALUES", instance[1])
    shape = FeedbackShape(**{"topology": None, "state_scales": {"x": scale}} | shape)
    plan = FeedbackPlan(shape, {"push": units})
    return make_planner(MDPOPlanner, problem_from(DOMAIN + text), plan)


def initial(owner):
    return owner.plan.initializer(jax.random.PRNGKey(0), {}, None)


def drawn(owner, *parts):
    """Parameters whose parts are random."""
    params = initial(owner)
    return params | {
        part: jax.tree.map(lambda leaf: jnp.asarray(RNG.normal(size=leaf.shape)), params[part])
        for part in parts
    }


def carry(source, params, target, is_same):
    plans = source.feedback_plan, target.feedback_plan
    return transferred(plans[0], params, plans[1], initial(target), is_same)


def push(owner, params, x, step=1):
    plan = owner.feedback_plan
    raw = plan.feedback.raw(params, {"x": jnp.asarray(x, jnp.float32)}, step)["push"]
    return np.asarray(plan.units["push"] * raw, float)


@pytest.fixture(scope="module")
def two():
    return planner(TWO)


def test_other_units_and_scales_play_the_same_actions(two):
    other = planner(TWO, units=7.0, scale=(-1.0, 3.0))
    params = drawn(two, "shared", "own")
    carried = carry(two, params, other, is_same=True)
    assert carried.left_out == ()
    for x in ([1.0, 3.0], [-2.5, 4.0]):
        ours, theirs = push(two, params, x), push(other, carried.params, x)
        np.testing.assert_allclose(theirs, ours, rtol=1e-4, atol=1e-4)


def test_gains_of_pairs_fit_other_units_and_scales_of_the_same_problem_only():
    source, other = planner(TWO, pairs=4), planner(TWO, units=7.0, scale=(-1.0, 3.0), pairs=4)
    params = drawn(source, "own")
    carried = carry(source, params, other, is_same=True)
    assert carried.left_out == ()
    for x in ([1.0, 3.0], [-2.5, 4.0]):
        ours, theirs = push(source, params, x), push(other, carried.params, x)
        np.testing.assert_allclose(theirs, ours, rtol=1e-4, atol=1e-4)
    own, three = initial(source)["own"]["push"], planner(THREE, pairs=9)
    own = {**own, "gains of pairs on x": jnp.array([[0.0, 4.0], [2.0, 0.0]])}
    carried = carry(source, {**initial(source), "own": {"push": own}}, three, is_same=False)
    assert carried.left_out == ("push: what each object has of its own, but for its mean",)
    np.testing.assert_array_equal(push(three, carried.params, [1.0, 3.0, 3.0]), 0.0)


def test_objects_that_are_alike_are_treated_alike_in_another_instance(two):
    three = planner(THREE, scale=(0.5, 1.5))
    params = drawn(two, "shared")
    carried = carry(two, params, three, is_same=False)
    assert carried.left_out == ()
    # a has weight 1 and its neighbour is b, in both instances
    np.testing.assert_allclose(
        push(three, carried.params, [1.0, 3.0, 3.0])[0], push(two, params, [1.0, 3.0])[0], rtol=1e-4
    )


def test_of_what_objects_have_of_their_own_the_mean_stays(two):
    three, params = planner(THREE), initial(two)
    params["own"] = {"push": {"bias": jnp.array([1.0, 3.0]), "gain on x": jnp.array([0.0, 4.0])}}
    carried = carry(two, params, three, is_same=False)
    # 2 (2 + 2 (x - 2) / 4)
    np.testing.assert_allclose(push(three, carried.params, [2.0, 4.0, 0.0]), [4.0, 6.0, 2.0])
    assert carried.left_out == ("push: what each object has of its own, but for its mean",)


@pytest.mark.parametrize("is_same", [True, False])
def test_a_hidden_layer_on_each_objects_features_fits_other_units_and_scales(is_same):
    source, other = planner(TWO, lifted=3), planner(TWO, units=7.0, scale=(-1.0, 3.0), lifted=3)
    params = drawn(source, "lifted")
    carried = carry(source, params, other, is_same)
    assert carried.left_out == ()
    for x in ([1.0, 3.0], [-2.5, 4.0]):
        ours, theirs = push(source, params, x), push(other, carried.params, x)
        np.testing.assert_allclose(theirs, ours, rtol=1e-3, atol=1e-3)


def test_a_hidden_layer_that_does_not_fit_is_named(two):
    source, simple = planner(TWO, lifted=3), planner(TWO, lifted=3, squares=False)
    params = drawn(source, "lifted")
    carried = carry(source, params, two, is_same=True)
    assert carried.left_out == ("push: the hidden layer on each object's features",)
    np.testing.assert_array_equal(push(two, carried.params, [1.0, 3.0]), 0.0)
    lost = carry(source, params, simple, is_same=True).left_out
    assert "push: x^2 in the hidden layer" in lost
    # what says nothing is not missed
    assert carry(source, initial(source), two, is_same=True).left_out == ()


@pytest.mark.parametrize("is_same", [True, False])
def test_a_plan_and_a_net_fit_the_same_problem_alone(is_same):
    shape = {"plan": True, "topology": (3,), "cosines": 0, "squares": False}
    source, target = planner(TWO, **shape), planner(TWO, units=1.0, **shape)
    params = drawn(source, "plan", "net")
    carried = carry(source, params, target, is_same)
    if is_same:
        assert carried.left_out == ()
        ours, theirs = (
            push(*pair, [1.0, 3.0]) for pair in ((source, params), (target, carried[0]))
        )
        np.testing.assert_allclose(theirs, ours, rtol=1e-5)
    else:
        assert carried.left_out == ("the open-loop plan", "the net")
        np.testing.assert_array_equal(push(target, carried.params, [1.0, 3.0]), 0.0)


def test_features_that_the_other_plan_lacks_are_named(two):
    other = planner(TWO, squares=False, cosines=1)
    lost = carry(two, drawn(two, "shared"), other, is_same=True).left_out
    assert "push: x^2" in lost
    assert "push: cos(2 pi t / H)" in lost
    assert "push: cos(1 pi t / H)" not in lost
