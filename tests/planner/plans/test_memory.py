"""What a policy remembers: means and traces, worked by hand, and what is no observation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import toy

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.plans.memory import Mean, MemoryShape, Trace
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel
from mdpo_rddl.planner.start import initial_values, unit_hyperparams

MEMORY = {
    "observations": [1.0, 2.0],
    "actions": [1.0],
    "observation_traces": [2.0],
    "action_traces": [4.0],
}


def followed(entry, values):
    """An entry after each of some values."""
    memory, found = jnp.asarray(entry.start(0.5)), []
    for count, value in enumerate(values):
        memory = entry.after(memory, jnp.asarray(value), jnp.asarray(float(count)))
        found.append(float(memory))
    return found


def test_a_mean_weighs_its_first_values_alike_and_later_ones_by_its_length():
    # 1/3 of the first and 2/3 of the second, then by 1/2^n
    assert followed(Mean("f", 2.0, False), [3.0, 6.0, 12.0]) == pytest.approx([3.0, 5.0, 9.0])
    long = followed(Mean("f", 1000.0, False), [1.0, 2.0, 6.0])
    assert long == pytest.approx([1.0, 1.5, 3.0], rel=1e-3)


def test_a_mean_over_one_step_is_the_last_value():
    assert followed(Mean("f", 1.0, False), [3.0, 6.0, -1.0]) == [3.0, 6.0, -1.0]


def test_a_trace_falls_with_the_steps_since():
    e = np.exp(-1.0 / 3.0)
    found = followed(Trace("f", 3.0, False), [0.0, 1.0, 0.0, 0.0, 1.0])
    assert found == pytest.approx([0.0, 1.0, e, e**2, 1.0])


@pytest.fixture(scope="module")
def planner():
    config = preset(1.0).without_section("Search")
    scales = {"seen": [0.5, 2.0]}
    config = config.with_policy_arguments(memory=MEMORY, state_scales=scales, topology=[])
    return build_planner(toy("drift"), config).planner


def after(planner, steps):
    """The memory after steps, each (fluents, actions)."""
    memory = planner.memory.initial
    for number, (fluents, actions) in enumerate(steps):
        memory = planner.memory.update(memory, number, fluents, actions)
    return {name: np.asarray(value).tolist() for name, value in memory.items()}


def step(seen, far, push, brake):
    pair = jnp.full(2, seen), jnp.full(2, push)
    return {"seen": pair[0], "far": far}, {"push": pair[1], "gear": 1, "brake": brake}


def test_before_anything_was_seen_a_mean_is_at_the_centre_and_a_trace_at_zero(planner):
    initial = after(planner, [])
    assert initial["last seen"] == [0.5, 0.5]
    assert initial["trace of far over 2 steps"] == 0.0
    assert initial["last push"] == [0.0, 0.0]


def test_what_is_shown_before_the_first_step_is_no_observation(planner):
    first = after(planner, [step(9.0, True, 1.0, True)])
    assert first["last seen"] == [0.5, 0.5]
    assert first["trace of far over 2 steps"] == 0.0
    second = after(planner, [step(9.0, True, 1.0, True), step(4.0, True, 0.0, True)])
    assert second["mean of seen over 2 steps"] == [4.0, 4.0]
    assert second["trace of far over 2 steps"] == 1.0


def test_actions_are_remembered_in_their_unit_from_the_no_op(planner):
    # the box of push is 4 wide, that of gear 3; the brake is on where nothing is done
    moved = after(planner, [step(0.0, False, 1.0, False)])
    assert moved["last push"] == [0.25, 0.25]
    assert moved["last gear"] == pytest.approx(1.0 / 3.0)
    assert moved["last brake"] == 1.0
    assert moved["trace of brake over 4 steps"] == 1.0
    assert after(planner, [step(0.0, False, 1.0, True)])["last brake"] == 0.0


def test_a_memory_is_read_in_the_scale_of_its_fluent(planner):
    feedback = planner.feedback_plan.feedback
    assert feedback.scale("mean of seen over 2 steps") == (0.5, 2.0)
    assert feedback.scale("last push") == (0.0, 1.0)
    # per unit of push its own two, and the brake's, which is everybody's
    names = feedback.names("push")
    assert {"last seen", "last seen^2", "trace of brake over 4 steps"} <= set(names)
    own = feedback.initial(jax.random.PRNGKey(0))["own"]
    assert "gain on last seen" in own["push"]
    assert "gain on last seen" not in own["brake"]


def test_training_takes_a_gradient_through_noisy_rollouts_with_a_memory(planner):
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    fluents, nonfluents = initial_values(planner).training
    noise = {
        name: jnp.full((2, planner.horizon, *shape), 0.1)
        for name, shape in planner.feedback_plan.feedback.action_shapes.items()
    }
    model = PerturbedModel(planner.compiled.model_aux["params"], noise)

    def loss(params):
        given = jax.random.PRNGKey(1), params, unit_hyperparams(planner), fluents, nonfluents
        return jnp.mean(planner.train_rollouts(*given, model)[0]["reward"])

    gradient = jax.jit(jax.grad(loss))(params)["own"]["push"]
    for name in ("gain on last seen", "gain on last push"):
        assert np.all(np.abs(gradient[name]) > 1e-4)


@pytest.mark.parametrize(
    ("memory", "message"),
    [
        ({"colours": [1.0]}, "memory: unknown key 'colours', known are observations, actions,"),
        ({"actions": [0.5]}, "memory: actions must be steps of at least 1, got 0.5"),
        ({"action_traces": 3.0}, "memory: action_traces must be a list of steps, got 3.0"),
        ([4.0], r"memory: must be a dictionary, got \[4.0\]"),
    ],
)
def test_what_cannot_be_remembered_is_refused_by_name(memory, message):
    with pytest.raises(InputError, match=rf"\[Planner\] method_kwargs: {message}"):
        preset(1.0).with_policy_arguments(memory=memory).checked()


def test_nothing_is_remembered_unless_it_is_said():
    assert MemoryShape.of(None) == MemoryShape()
    problem = toy("signal")
    planner = build_planner(problem, preset(1.0).without_section("Search")).planner
    assert planner.memory.initial == {}
    assert planner.feedback_plan.feedback.fluents == ["shown"]
