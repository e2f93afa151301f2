"""The measurements of speed and growth, and what a command sets up in JAX for them."""

import itertools
import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from helpers.problems import ROOT, make_plan, make_planner, tiny_files

from benchmarks.common.generate import hvac_instance, reservoir_instance
from benchmarks.common.records import Records
from benchmarks.speed import growth, profile, speed
from benchmarks.speed import rates as measuring
from benchmarks.speed.bare import PARTS, SCALE, compile_part
from benchmarks.speed.growth import draw_growth, growth_table, run_growth
from benchmarks.speed.profile import profile_table, run_profile
from benchmarks.speed.speed import Case, run_speed, speed_table
from mdpo_rddl import AdaptiveNoise
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.jax_setup import cache_folder
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.problem.load import load_problem, make_environment


@pytest.mark.parametrize(
    ("domain", "generate", "fluent"),
    [("reservoir", reservoir_instance, "rlevel"), ("hvac", hvac_instance, "temp-zone")],
)
def test_generated_instances_can_be_played(tmp_path, domain, generate, fluent):
    instance = tmp_path / "generated.rddl"
    for size in (1, 2, 7):
        instance.write_text(generate(size, 3))
        problem = load_problem(str(ROOT / "domains" / f"{domain}.rddl"), str(instance))
        env = make_environment(problem)
        state, _ = env.reset(seed=0)
        assert np.shape(state[fluent]) == (size,)
        _, reward, *_ = env.step({})
        assert np.isfinite(reward)
    assert generate(7, 3) == generate(7, 3)
    assert generate(7, 3) != generate(7, 4)


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_made_as_often_as_asked(tmp_path, part):
    problem = load_problem(*tiny_files(tmp_path, spread=0.3))
    planner = make_planner(
        MDPOPlanner, problem, make_plan("drp"), parallel_updates=2, noise=AdaptiveNoise()
    )
    bare = compile_part(planner, jax.random.PRNGKey(0), part)
    one, two = np.asarray(bare(1)), np.asarray(bare(2))
    assert one.shape == (2,)
    assert np.isfinite(two).all()
    if part != SCALE:  # draws nothing
        assert not np.array_equal(one, two)


def test_the_table_of_speeds_worked_by_hand(tmp_path):
    records = Records(tmp_path / "speed.csv", speed.COLUMNS, speed.KEYS)
    records.add("powergen7", "adaptive", 20, 50, "JaxPlan", 1000.4, 2500.6, 2.5, 1.5)
    records.add("hvac10", "adaptive", 1, 10, speed.COMMAND, 20.04, 10.0, 2.004, 2.0)
    assert speed_table(records).splitlines()[2:4] == [
        "| powergen7 | adaptive | 20 | 50 | JaxPlan | 1,000 | 2,501 | **2.50** | 1.5 |",
        "| hvac10 | adaptive | 1 | 10 | JaxPlan in a fresh process | 20.0 s | 10.0 s | **2.00**"
        " | 2.0 |",
    ]


class Clock:
    """A clock that stands still unless it is moved, in seconds."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        return self.now


def test_a_rate_is_iterations_of_all_seeds_by_the_clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(measuring, "time", clock)

    class Planner:
        def callbacks(self, key, budget):
            for iteration in itertools.count(step=5):
                clock.now += 0.25
                yield {"iteration": iteration}

    found = measuring.rates(Planner(), seeds=2, seconds=1.0)
    assert [next(found), next(found)] == [2 * 5 / 0.25] * 2

    def call(iterations):
        clock.now += 0.02 * iterations

    found = measuring.rates_of_calls(call, seeds=3, seconds=2.0, iterations=10)
    assert [next(found), next(found)] == [pytest.approx(3 / 0.02)] * 2


def test_speeds_are_measured_in_turn_and_once(tmp_path, monkeypatch):
    problem = load_problem(*tiny_files(tmp_path, spread=0.3))
    monkeypatch.setattr(speed, "load_setting", lambda name: problem)
    cases = (Case("adaptive", 2, 1, speed.JAXPLAN, 1.0), Case("adaptive", 3, 50, speed.BARE, 0.9))
    monkeypatch.setattr(speed, "CASES", cases)
    asked = []

    def shown(side, scale, seeds, seconds):
        for rate in (10.0, 30.0, 20.0):
            asked.append((side, seeds, seconds))
            yield scale * rate

    def rates(built, seeds, seconds):
        planner = built.planner
        assert planner.parallel_updates == seeds
        return shown(type(planner), 2.0 if type(planner) is MDPOPlanner else 1.0, seeds, seconds)

    def rates_of_calls(call, seeds, seconds, iterations):
        assert np.shape(call(1)) == (seeds,)
        return shown("bare", 1.0, seeds, seconds)

    monkeypatch.setattr(speed, "rates", rates)
    monkeypatch.setattr(speed, "rates_of_calls", rates_of_calls)
    records = run_speed(tmp_path, ["tiny"], turns=3, seconds=0.5, command_turns=0)
    assert asked == [
        *[(JaxBackpropPlanner, 2, 0.5), (MDPOPlanner, 2, 0.5)] * 3,
        *[("bare", 3, 0.5), (MDPOPlanner, 3, 0.5)] * 3,
    ]
    assert [(row["theirs"], row["ours"], row["ratio"]) for row in records.rows] == 2 * [
        ("20.0", "40.0", "2.0")
    ]
    run_speed(tmp_path, ["tiny"], turns=3, seconds=0.5, command_turns=0)
    assert len(asked) == 12


@pytest.mark.slow
@pytest.mark.parametrize("against", [speed.JAXPLAN, speed.BARE])
def test_both_sides_are_really_run(tmp_path, monkeypatch, against):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(speed, "CASES", (Case("adaptive", 2, 1, against, 1.0),))
    (row,) = run_speed(tmp_path, ["powergen7"], turns=1, seconds=0.2, command_turns=0).rows
    assert float(row["theirs"]) > 0
    assert float(row["ours"]) > 0


def test_the_table_of_the_profile_worked_by_hand(tmp_path):
    records = Records(tmp_path / "profile.csv", profile.COLUMNS, profile.KEYS)
    times = (900.0, 400.0, 520.0, 30.0, 20.0, 1000.4, 1500.0, 1800.0, 2000.0)
    for part, microseconds in zip(profile.MEASURED, times, strict=True):
        records.add("hvac10", 20, part, microseconds)
    assert profile_table(records).splitlines()[2] == (
        "| hvac10 | 20 | 400 | 520 | 50 | 50 | 1,000 | 500 | 300 | 2,000 |"
    )


@pytest.mark.slow
def test_a_profile_is_measured_once(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(profile, "SEEDS", (1,))
    records = run_profile(tmp_path, ["powergen7"], turns=1, seconds=0.1)
    assert [row["part"] for row in records.rows] == list(profile.MEASURED)
    found = {row["part"]: float(row["microseconds"]) for row in records.rows}
    assert 0 < found["analysis gradient"] < found["both gradients"]
    monkeypatch.setattr(profile, "build_planner", None)
    assert run_profile(tmp_path, ["powergen7"], turns=1, seconds=0.1).rows == records.rows


@pytest.mark.slow
def test_growth_is_measured_and_drawn(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(growth, "AXES", {**growth.AXES, "reservoirs": (2,)})
    records = run_growth(tmp_path, ["reservoirs"], 0.1, Limits(300, 8))
    (row,) = records.rows
    assert row["status"] == "ok"
    assert float(row["milliseconds"]) > 0
    assert (tmp_path / "growth.png").stat().st_size > 10_000


def test_the_table_of_growth_worked_by_hand(tmp_path):
    records = Records(tmp_path / "growth.csv", growth.COLUMNS, growth.KEYS)
    records.add("zones", 30, "ok", 5.0, 11, 700.2, "2 cpu")
    records.add("zones", 10, "ok", 2.0, 10, 600, "2 cpu")
    records.add("zones", 100, "over 8 GB", "", "", "", "")
    assert growth_table(records).splitlines()[2:] == [
        "| zones | 10 | 2.00 |  |  | 600 | 10 |",
        "| zones | 30 | 5.00 | x 2.5 | x 3.0 | 700 | 11 |",
        "| zones | 100 | over 8 GB | | | | |",
        "",
        "Devices: 2 cpu. Memory is that of the whole process.",
    ]
    draw_growth(records, tmp_path / "growth.png")
    assert (tmp_path / "growth.png").is_file()


def test_compiled_programs_are_kept_where_the_user_says(monkeypatch, tmp_path):
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "mdpo-rddl" / "jax"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "mdpo-rddl" / "jax"


CACHED = """
import sys
from mdpo_rddl.machine.jax_setup import keep_compiled_programs, use_all_cores
keep_compiled_programs()
use_all_cores()
import jax
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.jit(lambda x: x * 2)(1.0)
print(len(jax.devices()))
"""


@pytest.mark.parametrize("given", [{}, {"JAX_NUM_CPU_DEVICES": "3"}])
def test_the_cache_is_filled_and_every_core_is_a_device(tmp_path, given):
    ours = ("XLA_FLAGS", "JAX_NUM_CPU_DEVICES", "JAX_COMPILATION_CACHE_DIR")
    kept = {k: v for k, v in os.environ.items() if k not in ours}
    environment = {**kept, "XDG_CACHE_HOME": str(tmp_path), **given}
    command = [sys.executable, "-c", CACHED]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert int(done.stdout) == (3 if given else cores)
    assert list((tmp_path / "mdpo-rddl" / "jax").iterdir())
