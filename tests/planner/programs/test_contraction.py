"""Sums of products over pairs, as matrix products."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.x64 import enable_x64

from mdpo_rddl.planner.programs import contraction
from mdpo_rddl.planner.programs.contraction import contract
from mdpo_rddl.planner.programs.staging import Stages

N, M = 90, 80
RANDOM = np.random.default_rng(0)
A = jnp.asarray(RANDOM.normal(size=(N, M)), jnp.float32)
B = jnp.asarray(RANDOM.normal(size=(M, N)), jnp.float32)
X = jnp.asarray(RANDOM.normal(size=N), jnp.float32)
Y = jnp.asarray(RANDOM.normal(size=M), jnp.float32)


def spread(vector, shape, axis):
    """A vector along an axis; a number everywhere."""
    return jax.lax.broadcast_in_dim(vector, shape, () if axis is None else (axis,))


def products(a, b, x, y):
    """Each result is computed over pairs, as a compiler of RDDL writes it."""
    pairs, rows, columns = (N, M), spread(x, (N, M), 0), spread(y, (N, M), 1)
    difference = 1.0 * columns - rows
    return {
        "matrix times vector": jnp.sum(a * columns, axis=1),
        "over the other axis": jnp.sum(rows * a * columns, axis=0),
        "difference": jnp.sum(a * difference, axis=1),
        "everything": jnp.sum(-(a * difference) + rows),
        "transposed": jnp.sum(jnp.transpose(b) * rows, axis=1),
        "constant along an axis": jnp.sum(jnp.tanh(columns) / (1.0 + columns**2), axis=1),
        "not a product": jnp.sum(jnp.maximum(rows, columns), axis=1),
        "used twice": (jnp.sum(rows * columns, axis=1), jnp.max(rows * columns, axis=0)),
        "many terms": jnp.sum((rows + columns) ** 2 * (rows - columns) * (rows + a), axis=1),
        "nested": jax.jit(lambda r, c: jnp.sum(r * c * a, axis=1))(rows, columns),
        "two matrices": jnp.sum(
            a * columns * jnp.transpose(spread(b.sum(1), (M, N), 0)) * a, axis=1
        ),
        "three axes": jnp.sum(
            jax.lax.broadcast_in_dim(a, (N, M, 5), (0, 1))
            * jax.lax.broadcast_in_dim(b[:, :5], (N, M, 5), (1, 2)),
            axis=(0, 1),
        ),
        "exists": jnp.any((a > 1.0) & (columns > 0.0), axis=1),
        "exists in both": jnp.any((a > 0.0) & (columns > 1.5) & (rows > 1.5), axis=(0, 1)),
        "for all": jnp.all((a < 0.0) | (columns < 1.0), axis=1),
        "no pair": jnp.all(~((a > 2.0) & (columns > 1.0)), axis=1),
        "counted": jnp.sum(((a > 1.0) & (columns > 0.0)) * 1.0 * rows, axis=0),
        "counted as integers": jnp.sum(1 * ((a > 1.0) & (columns > 0.0)).astype(int), axis=0),
        "one less another": jnp.sum(
            ((a > 0.0) & (columns > 0.0)).astype(int) - ((a > 1.0) & (rows > 0.0)), axis=1
        ),
        "integers times truths": jnp.sum(
            ((a > 1.0) & (columns > 0.0)) * jnp.arange(N)[:, jnp.newaxis], axis=1
        ),
        "exactly one": jnp.any((a > 1.0) ^ (columns > 0.0), axis=1),
        "one of two numbers": jnp.sum(
            a * jnp.where(columns > 0.0, spread(x[0], pairs, None), spread(x[1], pairs, None)),
            axis=1,
        ),
        "a number or a vector": jnp.sum(
            a * jnp.where(columns > 0.0, spread(x[0], pairs, None), columns), axis=1
        ),
        "by one truth": jnp.sum(
            a * jnp.where(spread(x[0] > 0.0, pairs, None), rows, spread(x[1], pairs, None)), axis=1
        ),
        "truths": (a > 1.0) & (columns > 0.0),
        "whole": rows * columns,
        "integers": jnp.sum(jnp.broadcast_to(jnp.arange(M), pairs) * 2, axis=1),
    }


def evaluate(program, *arguments):
    return jax.tree.leaves(jax.jit(jax.extend.core.jaxpr_as_fun(program))(*arguments))


def test_the_results_are_the_same():
    program = jax.make_jaxpr(products)(A, B, X, Y)
    expected = evaluate(program, A, B, X, Y)
    for one, other in zip(evaluate(contract(program), A, B, X, Y), expected, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, rtol=2e-4, atol=2e-3)


@pytest.mark.parametrize(
    "name",
    [
        "matrix times vector",
        "over the other axis",
        "difference",
        "constant along an axis",
    ],
)
def test_no_matrix_of_pairs_is_computed(name):
    program = contract(jax.make_jaxpr(lambda *v: products(*v)[name])(A, B, X, Y))
    used = jax.jit(jax.extend.core.jaxpr_as_fun(program)).lower(A, B, X, Y).compile()
    assert used.memory_analysis().temp_size_in_bytes < 4 * N * M


def test_matrices_that_no_step_changes_are_one_ahead_of_the_steps():
    def step(a, b, y):
        every, other = (jax.lax.broadcast_in_dim(m, m.shape, (0, 1)) for m in (a, b))
        return jnp.sum(every * spread(y, (N, M), 1) * jnp.transpose(other), axis=1)

    stages = Stages(lambda fixed, y: step(*fixed, y), (A, B), Y)
    fixed = stages.run(0, [], (A, B))
    program = jax.make_jaxpr(lambda y: stages.run(1, [fixed], y))(Y)
    results = [out.aval.size for each in program.jaxpr.eqns for out in each.outvars]
    assert max(results) < N * M
    np.testing.assert_allclose(stages.run(1, [fixed], Y), step(A, B, Y), rtol=2e-4, atol=2e-3)


def differences(x, y):
    """Sums over pairs whose terms are far smaller than the products of what they are made of."""
    rows, columns = spread(x, (N, M), 0), spread(y, (N, M), 1)
    both = (rows > 1000.0) & (columns > 999.0)
    costs = spread(jnp.where(y > 999.0, 1e8, 1.0), (N, M), 1)
    return {
        "squares": jnp.sum((rows - columns) * (rows - columns), axis=1),
        "two differences": jnp.sum((rows - columns) * (1000.0 - rows) * (columns - rows), axis=1),
        "scaled": jnp.sum(-(rows - columns) * 0.5 * (columns - rows), axis=0),
        "what is left": jnp.sum(~both * 1.0 * costs, axis=1),
        "none is left": jnp.sum((1.0 - both * 1.0) * costs, axis=1),
    }


def test_what_cancels_is_not_multiplied_out():
    x = jnp.asarray(1000.0 + RANDOM.uniform(0.01, 0.02, N), jnp.float32)
    y = jnp.asarray(x[:M] - 0.001 * RANDOM.uniform(size=M), jnp.float32)
    program = jax.make_jaxpr(differences)(x, y)
    found = jax.tree.unflatten(
        jax.tree.structure(differences(x, y)), evaluate(contract(program), x, y)
    )
    with enable_x64(True):
        exact = differences(np.asarray(x, np.float64), np.asarray(y, np.float64))
    for name, expected in exact.items():
        np.testing.assert_allclose(found[name], expected, rtol=1e-4, err_msg=name)


def test_products_of_truths_are_multiplied_out():
    def program(a, y):
        columns = spread(y > 1.0, (N, M), 1)
        return jnp.any((a > 1.5) & columns & ~((a > 2.5) & columns), axis=1)

    contracted = contract(jax.make_jaxpr(program)(A, Y))
    names = {equation.primitive.name for equation in contracted.jaxpr.eqns}
    assert "reduce_or" not in names
    assert "dot_general" in names
    (found,) = evaluate(contracted, A, Y)
    np.testing.assert_array_equal(found, program(A, Y))
    assert 0 < np.sum(found) < N


def count(truths, other):
    """How many pairs are true in both, for each object of a third type, as an integer."""
    shape = (5, N, M)
    pairs = jax.lax.broadcast_in_dim(truths, shape, (1, 2))
    both = pairs & jax.lax.broadcast_in_dim(other, shape, (0, 2))
    return jnp.sum(jnp.asarray(1, jnp.int32) * both.astype(jnp.int32), axis=(1, 2))


def test_truths_are_counted_without_the_pairs():
    truths, other = A > 0.5, B.T[:5, :] > 0.0
    program = contract(jax.make_jaxpr(count)(truths, other))
    assert max(out.aval.size for each in program.jaxpr.eqns for out in each.outvars) <= N * M
    (found,) = evaluate(program, truths, other)
    np.testing.assert_array_equal(found, count(truths, other))
    assert found.dtype == jnp.int32


def test_more_truths_than_single_precision_counts_are_added_as_integers(monkeypatch):
    truths, other = A > 0.5, B.T[:5, :] > 0.0
    monkeypatch.setattr(contraction, "_MOST_COUNTED", N * M - 1)
    program = contract(jax.make_jaxpr(count)(truths, other))
    names = {equation.primitive.name for equation in program.jaxpr.eqns}
    assert "dot_general" not in names
    np.testing.assert_array_equal(evaluate(program, truths, other)[0], count(truths, other))


def test_gradients_are_the_same():
    program = jax.make_jaxpr(lambda *v: products(*v)["difference"])(A, B, X, Y)

    def total(run):
        return lambda x, y: jnp.sum(jnp.sin(jax.extend.core.jaxpr_as_fun(run)(A, B, x, y)[0]))

    found = jax.grad(total(contract(program)), (0, 1))(X, Y)
    expected = jax.grad(total(program), (0, 1))(X, Y)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)


def test_small_programs_stay_as_they_are():
    program = jax.make_jaxpr(lambda a, y: jnp.sum(a * spread(y, (4, 3), 1), axis=1))(
        A[:4, :3], Y[:3]
    )
    assert contract(program) is program
