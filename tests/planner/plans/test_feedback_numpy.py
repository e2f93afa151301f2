"""The formula of a feedback policy on numpy, for replicas, is that of JAX."""

import dataclasses
from functools import partial

import jax
import numpy as np
import pytest
from helpers.problems import make_planner, shipped
from helpers.toys import toy
from helpers.vans import vans

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.limits import choose_within_limits
from mdpo_rddl.planner.plans.lookups import lookups
from mdpo_rddl.problem.limits import GroupLimit

EVERYTHING = FeedbackShape(
    topology=(5, 4), cosines=2, squares=True, distant=True, lifted=3, pairs=100_000, plan=True
)
MEMORY = {
    "observations": [1.0, 3.0],
    "actions": [2.0],
    "observation_traces": [2.0],
    "action_traces": [3.0],
}
REPLICAS = 7
# relations of objects; whole numbers and bools where the state is not observed; objects as values;
# relations in two steps
PROBLEMS = {
    "reservoir": partial(shipped, "reservoir15", 8),
    "drift": partial(toy, "drift"),
    "vans": vans,
    "crossroads": partial(shipped, "crossroads5", 8),
}


def compiled(name):
    problem = PROBLEMS[name]()
    shape = dataclasses.replace(EVERYTHING, memory=MEMORY, lookups=tuple(lookups(problem.model)))
    planner = make_planner(MDPOPlanner, problem, FeedbackPlan(shape))
    return planner.plan


def drawn(plan, random):
    """Random parameters, and a random state of each replica with a memory [B, *shape]."""
    params = jax.tree.map(
        lambda leaf: 0.2 * random.normal(size=np.shape(leaf)).astype(np.float32), plan.noop(0)
    )
    feedback = plan.feedback
    state = {
        name: random.integers(0, 3, (REPLICAS, *feedback.shapes[name])).astype(np.float32)
        for name in feedback.seen
    }
    return params, state


@pytest.mark.parametrize("name", PROBLEMS)
def test_replicas_on_numpy_are_single_states_under_jax(name):
    plan = compiled(name)
    params, state = drawn(plan, np.random.default_rng(3))
    replicas = {key: np.moveaxis(value, 0, -1) for key, value in state.items()}
    for function in ("raw", "relaxed", "played"):
        for step in (0, 3):
            here, there = plan.actions, plan.actions.on_numpy()
            if function == "raw":
                here, there = here.feedback, there.feedback
            squash = {"squash": lambda x: x} if function == "relaxed" else {}
            call = partial(getattr(here, function), params, step=step, **squash)
            expected = jax.vmap(lambda one, call=call: call(state=one))(state)
            found = getattr(there, function)(params, replicas, step, **squash)
            assert set(found) == set(expected)
            for action, value in found.items():
                assert type(value) is np.ndarray
                like = np.moveaxis(np.asarray(expected[action]), 0, -1)
                # a raw action is in units
                unit = 1.0 if function == "raw" else np.max(plan.units.get(action, 1.0))
                value = np.broadcast_to(value, like.shape)
                np.testing.assert_allclose(value, like, rtol=1e-5, atol=1e-5 * unit)
    raw = plan.actions.on_numpy().feedback.raw(params, replicas, 3)
    assert all(np.ptp(value) > 0.0 for value in raw.values())


@pytest.mark.parametrize("name", PROBLEMS)
def test_their_memory_is_that_of_jax(name):
    plan = compiled(name)
    random = np.random.default_rng(4)
    params, state = drawn(plan, random)
    replicas = {key: np.moveaxis(value, 0, -1) for key, value in state.items()}
    actions, there = plan.actions, plan.actions.on_numpy()
    memory = {key: replicas[key] for key in actions.feedback.empty_memory()}
    assert memory
    played = there.played(params, replicas, 2)
    for step in (0, 2):
        found = there.remembered(memory, step, replicas, played)
        update = partial(actions.remembered, step=step)
        expected = jax.vmap(lambda m, s, a, u=update: u(m, state=s, actions=a))(
            {key: state[key] for key in memory},
            state,
            {key: np.moveaxis(value, -1, 0) for key, value in played.items()},
        )
        for entry, value in found.items():
            like = np.moveaxis(np.asarray(expected[entry]), 0, -1)
            np.testing.assert_allclose(value, like, rtol=1e-5, atol=1e-6)


def test_limits_on_groups_choose_alike_in_each_replica():
    random = np.random.default_rng(5)
    # with ties
    likely = {n: random.integers(0, 9, (4, 3, 50)).astype(np.float32) / 8.0 for n in "ab"}
    row = np.repeat([[0], [1], [-1], [1]], 3, axis=1)
    limits = [
        GroupLimit({"a": row, "b": row.copy()}, np.array([2, 1])),
        GroupLimit({"b": np.arange(12).reshape(4, 3) % 2}, np.array([1, 3]), exact=True),
    ]
    found = choose_within_limits(likely, limits)
    one_by_one = jax.vmap(partial(choose_within_limits, limits=limits), -1, -1)(likely)
    for name in likely:
        np.testing.assert_array_equal(found[name], one_by_one[name])
    assert 0.0 < np.mean(found["a"]) < np.mean(likely["a"] > 0.5)
