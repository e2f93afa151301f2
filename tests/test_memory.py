"""Large models: what a rollout keeps for its gradient, and that keeping less changes nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import make_plan, make_planner, optimize, shipped

from mdpo_rddl.jaxplan import memory
from mdpo_rddl.jaxplan.memory import bounded_step
from mdpo_rddl.jaxplan.planner import MDPOPlanner

STEPS = 50
WIDTH = 2000  # a step's matrix has 16 MB


def step(carry, row):
    product = jnp.tanh(carry[:, None] * row[None, :])
    return jnp.mean(jnp.sin(product), axis=1), jnp.sum(product**2)


def _program(chosen):
    def total(start, rows):
        end, sums = jax.lax.scan(chosen, start, rows)
        return jnp.sum(end) + jnp.sum(sums)

    arguments = jnp.linspace(-1.0, 1.0, WIDTH), jnp.ones((STEPS, WIDTH))
    return jax.jit(jax.grad(total)).lower(*arguments).compile()


def test_a_small_step_stays_as_it_is(monkeypatch):
    first, row = jnp.ones(WIDTH), jnp.ones(WIDTH)
    assert bounded_step(step, first, row, steps=1) is step
    # four matrices of 16 MB, and vectors
    monkeypatch.setattr(memory, "KEPT_BYTES", 4.2 * 4 * WIDTH**2 * STEPS)
    assert bounded_step(step, first, row, STEPS) is step
    monkeypatch.setattr(memory, "KEPT_BYTES", 3.9 * 4 * WIDTH**2 * STEPS)
    assert bounded_step(step, first, row, STEPS) is not step


def test_a_large_step_keeps_nothing_but_its_carry(monkeypatch):
    monkeypatch.setattr(memory, "KEPT_BYTES", 10**9)
    bounded = bounded_step(step, jnp.ones(WIDTH), jnp.ones(WIDTH), STEPS)
    kept, plain = (_program(each).memory_analysis().temp_size_in_bytes for each in (bounded, step))
    assert plain > STEPS * 4 * WIDTH**2
    assert kept < 10 * 4 * WIDTH**2


@pytest.mark.parametrize("kind", ["drp", "slp"])
def test_training_is_the_same_either_way(monkeypatch, kind):
    problem = shipped("powergen7", horizon=6)
    found = []
    for kept_bytes in (memory.KEPT_BYTES, 0):
        monkeypatch.setattr(memory, "KEPT_BYTES", kept_bytes)
        planner = make_planner(MDPOPlanner, problem, make_plan(kind))
        callback = optimize(planner, epochs=4)
        found.append((callback["params"], callback["sigma"], callback["train_return"]))
    for one, other in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)
