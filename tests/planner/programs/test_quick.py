"""Programs for short searches: less optimised, the same otherwise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import tiny_files

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.programs import quick
from mdpo_rddl.planner.programs.quick import is_short, jit_for, light_jit, quick_jit, quick_share
from mdpo_rddl.problem.load import load_problem


@pytest.mark.parametrize("lighter_jit", [quick_jit, light_jit])
def test_a_lighter_program_computes_the_same(monkeypatch, lighter_jit):
    monkeypatch.delenv("XLA_FLAGS")

    def walk(start):
        return jax.lax.fori_loop(0, 50, lambda step, x: jnp.cos(x) + 0.1 * x, start)

    start = np.linspace(-3.0, 3.0, 40, dtype=np.float32)
    np.testing.assert_allclose(lighter_jit(walk)(start), jax.jit(walk)(start), rtol=1e-5)


@pytest.mark.parametrize("lighter_jit", [quick_jit, light_jit])
def test_a_lighter_program_can_be_a_part_of_another_one(monkeypatch, lighter_jit):
    monkeypatch.delenv("XLA_FLAGS")
    square = lighter_jit(lambda x: x**2)
    start = np.linspace(-3.0, 3.0, 40, dtype=np.float32)
    found = jax.jit(lambda x: jax.lax.fori_loop(0, 1, lambda _, y: square(x=y), x))(start)
    np.testing.assert_allclose(found, start**2, rtol=1e-6)
    np.testing.assert_allclose(jax.vmap(jax.grad(square))(start), 2.0 * start, rtol=1e-6)


def test_what_the_user_s_flags_say_stays(monkeypatch):
    given = []
    monkeypatch.setattr(quick, "_is_known", lambda name, value: True)
    monkeypatch.setattr(
        jax, "jit", lambda function, compiler_options: given.append(compiler_options)
    )
    for flags in ("", "--xla_backend_optimization_level=0"):
        monkeypatch.setenv("XLA_FLAGS", flags)
        light_jit(abs)
        quick_jit(abs)
    level, emitters = "xla_backend_optimization_level", "xla_cpu_use_fusion_emitters"
    assert given == [{level: 1}, {level: 1, emitters: False}, {}, {emitters: False}]


def test_an_option_that_xla_does_not_have_is_left_out(monkeypatch):
    monkeypatch.delenv("XLA_FLAGS")
    options = {"xla_backend_optimization_level": 1, "xla_of_another_release": False}
    monkeypatch.setattr(quick, "QUICK_OPTIONS", options)
    assert quick_jit(jnp.square)(3.0) == 9.0
    assert quick_share() == 1.0


def test_short_searches_have_quick_programs():
    assert is_short(60.0)
    assert jit_for(60.0) is quick_jit
    assert jit_for(600.0) is jax.jit


@pytest.mark.parametrize("is_stored", [False, True])
def test_a_planner_compiles_its_calls_by_what_it_is_given(tmp_path, is_stored):
    compiled = []

    def jit(function):
        compiled.append(function)
        return jax.jit(function)

    problem = load_problem(*tiny_files(tmp_path))
    folder = tmp_path / "traced" if is_stored else None
    build_planner(problem, PRESETS["paper"]("tiny"), folder, jit=jit)
    assert compiled
