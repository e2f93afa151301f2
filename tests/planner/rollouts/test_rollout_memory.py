"""Large models: what a rollout keeps for its gradient, and that keeping less changes nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner, optimize, tiny_files

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.rollouts import memory
from mdpo_rddl.planner.rollouts.memory import bounded_scan
from mdpo_rddl.problem.load import load_problem

STEPS = 50
WIDTH = 2000  # a step has four matrices of 16 MB, of which its gradient needs one or two
MATRIX = 4 * WIDTH**2


def step(carry, row):
    product = jnp.tanh(carry[:, None] * row[None, :])
    return jnp.mean(jnp.sin(product), axis=1), jnp.sum(product**2)


def total(start, rows):
    end, sums = bounded_scan(step, start, rows)
    return jnp.sum(end) + jnp.sum(sums)


def arguments(width, steps):
    rows = jnp.cos(jnp.arange(steps * width, dtype=jnp.float32)).reshape(steps, width)
    return jnp.linspace(-1.0, 1.0, width), rows


def temporary_bytes(steps):
    program = jax.jit(jax.grad(total)).lower(*arguments(WIDTH, steps)).compile()
    return program.memory_analysis().temp_size_in_bytes


def blocks(steps, copies=1):
    """How many blocks of how many steps are computed again on the way back."""
    first, rows = arguments(WIDTH, steps)
    program = jax.make_jaxpr(lambda *given: bounded_scan(step, *given, copies))(first, rows)
    return [
        (scan.params["length"], inner.params["jaxpr"].eqns[0].params["length"])
        for scan in program.eqns
        if scan.primitive.name == "scan"
        for inner in scan.params["jaxpr"].eqns
        if "checkpoint" in inner.primitive.name or "remat" in inner.primitive.name
    ]


def test_blocks_are_computed_again_where_the_values_between_do_not_fit(monkeypatch):
    # the four matrices of each of fifty steps, and vectors
    monkeypatch.setattr(memory, "KEPT_BYTES", 4.2 * MATRIX * STEPS)
    assert blocks(STEPS) == []
    assert blocks(2 * STEPS) == [(10, 10)]
    assert blocks(STEPS, copies=2) == [(5, 10)]
    monkeypatch.setattr(memory, "KEPT_BYTES", 3.9 * MATRIX * STEPS)
    assert blocks(STEPS) == [(5, 10)]
    assert blocks(53) == [(4, 13)]  # and one step
    monkeypatch.setattr(memory, "KEPT_BYTES", 4.2 * MATRIX * 3)
    assert blocks(STEPS) == [(25, 2)]
    monkeypatch.setattr(memory, "KEPT_BYTES", 3.9 * MATRIX)
    assert blocks(STEPS) == [(STEPS, 1)]


def test_a_long_horizon_keeps_only_one_block(monkeypatch):
    monkeypatch.setattr(memory, "KEPT_BYTES", 10**12)
    unbounded = temporary_bytes(STEPS)
    monkeypatch.setattr(memory, "KEPT_BYTES", 4.2 * MATRIX * STEPS)
    assert temporary_bytes(2 * STEPS) < unbounded / 2  # blocks of ten steps


def test_a_large_step_keeps_nothing_but_its_carry(monkeypatch):
    monkeypatch.setattr(memory, "KEPT_BYTES", MATRIX)
    assert temporary_bytes(STEPS) < 10 * MATRIX


@pytest.mark.parametrize("fitting", [0, 1, 3, 7, 20, 36, 49])
def test_the_gradient_is_the_same_however_much_is_kept(monkeypatch, fitting):
    given = arguments(30, STEPS)
    monkeypatch.setattr(memory, "KEPT_BYTES", 10**12)
    expected = jax.value_and_grad(total, (0, 1))(*given)
    between = memory._bytes_between(jax.make_jaxpr(step)(given[0], given[1][0]).jaxpr)
    monkeypatch.setattr(memory, "KEPT_BYTES", fitting * between)
    found = jax.value_and_grad(total, (0, 1))(*given)
    for one, other in zip(*map(jax.tree.leaves, (found, expected)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "kept_bytes"), [("drp", 0), ("slp", 10**3)])
def test_training_is_the_same_either_way(tmp_path, monkeypatch, kind, kept_bytes):
    # smooth: no rounding decides on which side of a threshold something lies
    problem = load_problem(*tiny_files(tmp_path, horizon=6))
    found = []
    for most in (memory.KEPT_BYTES, kept_bytes):
        monkeypatch.setattr(memory, "KEPT_BYTES", most)
        planner = make_planner(MDPOPlanner, problem, make_plan(kind))
        callback = optimize(planner, epochs=4)
        found.append((callback["params"], callback["sigma"], callback["train_return"]))
    for one, other in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)
