"""Traced programs on disk: the same results, untraced in the next process."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import assert_same_bits, tiny_files

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.programs import stored as stored_programs
from mdpo_rddl.planner.programs.stored import stored_jit
from mdpo_rddl.problem.load import load_problem


class Counted:
    """A function that tells how often it was traced."""

    def __init__(self):
        self.traced = 0

    def __call__(self, count, tree):
        self.traced += 1
        return {"sum": jnp.sum(tree["x"]) * count, "same": (tree["x"], None)}


TREE = {"x": np.linspace(0.0, 1.0, 7, dtype=np.float32)}


def test_a_second_process_does_not_trace(tmp_path):
    first, second = Counted(), Counted()
    expected = jax.jit(Counted())(3, TREE)
    found = [stored_jit(tmp_path, "it", function)(3, TREE) for function in (first, second)]
    assert (first.traced, second.traced) == (1, 0)
    for result in found:
        assert jax.tree.structure(result) == jax.tree.structure(expected)
        assert_same_bits(result, expected)


def test_it_decorates(tmp_path):
    assert stored_jit(tmp_path, "it")(Counted())(2, {"x": jnp.ones(2)})["sum"] == 4


@pytest.mark.parametrize(
    ("identity", "tree"),
    [
        ("another", TREE),
        ("it", {"x": np.ones(8, np.float32)}),
        ("it", {"x": np.ones(7, np.int32)}),
        ("it", {"x": TREE["x"], "y": TREE["x"]}),
    ],
)
def test_another_function_or_argument_is_another_program(tmp_path, identity, tree):
    stored_jit(tmp_path, "it", Counted())(3, TREE)
    other = Counted()
    result = stored_jit(tmp_path, identity, other)(3, tree)
    assert other.traced == 1
    assert result["sum"] == 3 * np.sum(tree["x"])


def test_so_it_is_with_other_code(tmp_path, monkeypatch):
    stored_jit(tmp_path / "kept", "it", Counted())(3, TREE)
    package = tmp_path / "somebody_s"
    package.mkdir()
    (package / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(stored_programs, "_TRACED_PACKAGES", ("mdpo_rddl", "somebody_s"))
    traced = []
    for edited in ("x = 1", "x = 1", "x = 11"):
        if not traced or edited != "x = 1":
            (package / "module.py").write_text(edited)
        stored_programs._code.cache_clear()
        other = Counted()
        stored_jit(tmp_path / "kept", "it", other)(3, TREE)
        traced.append(other.traced)
    assert traced == [1, 0, 1]
    stored_programs._code.cache_clear()


def test_results_can_be_arguments_without_another_compilation(tmp_path):
    compilations = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, *_, **__: compilations.append(event) if "backend_compile" in event else None
    )
    function = stored_jit(tmp_path, "it", lambda number, x: (number + 1, x * 2))
    results = function(1, jnp.ones(3))
    done = len(compilations)
    assert done > 0
    for _ in range(3):
        results = function(*results)
    assert len(compilations) == done
    assert results[0] == 5


def test_a_damaged_file_is_replaced(tmp_path):
    stored_jit(tmp_path, "it", Counted())(3, TREE)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:100])
    repairing, after = Counted(), Counted()
    for function in (repairing, after):
        assert stored_jit(tmp_path, "it", function)(3, TREE)["sum"] == 3 * np.sum(TREE["x"])
    assert (repairing.traced, after.traced) == (1, 0)


def test_what_jax_cannot_export_is_computed_all_the_same(tmp_path):
    def calling_back(x):
        return jax.pure_callback(np.sin, jax.ShapeDtypeStruct((), jnp.float32), x)

    result = stored_jit(tmp_path, "it", calling_back)(jnp.float32(1.0))
    np.testing.assert_allclose(result, np.sin(1.0), rtol=1e-6)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_costs_nothing_but_time(tmp_path):
    (tmp_path / "file").write_text("")
    assert stored_jit(tmp_path / "file" / "in", "it", Counted())(1, TREE)["sum"] == 3.5


def test_the_longest_unused_go_first(tmp_path, monkeypatch):
    monkeypatch.setattr(stored_programs, "_MOST_FILES", 2)
    stored_jit(tmp_path, "a", Counted())(3, TREE)
    stored_jit(tmp_path, "b", Counted())(3, TREE)
    stored_jit(tmp_path, "a", Counted())(3, TREE)
    stored_jit(tmp_path, "c", Counted())(3, TREE)
    again = {name: Counted() for name in "ac"}
    for name, function in again.items():
        stored_jit(tmp_path, name, function)(3, TREE)
    assert len(list(tmp_path.iterdir())) == 2
    assert [function.traced for function in again.values()] == [0, 0]


SPREAD = """
import sys
from pathlib import Path
import jax
jax.config.update("jax_num_cpu_devices", 2)
from mdpo_rddl.planner.programs.stored import stored_jit
from mdpo_rddl.problem.load import load_problem
mesh = jax.make_mesh((2,), ("x",))
spread = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("x"))
x = jax.device_put(jax.numpy.arange(4.0), spread)
result = stored_jit(Path(sys.argv[1]), "it", lambda x: x + 1)(x)
print(result.sharding == x.sharding, result.tolist())
"""


def test_arguments_on_several_devices_stay_there(tmp_path):
    command = [sys.executable, "-c", SPREAD, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "True [1.0, 2.0, 3.0, 4.0]\n"


@pytest.mark.long
def test_a_planner_trains_the_same_from_a_stored_program(tmp_path, monkeypatch):
    (tmp_path / "programs").mkdir()
    problem = load_problem(*tiny_files(tmp_path, spread=0.3))
    sizes = {"iterations_per_call": 4, "test_every": 2}
    config = PRESETS["paper"]("tiny").with_values("MDPO", **sizes)

    def built(programs):
        return build_planner(problem, config, programs).planner

    def trained(planner, seed):
        *_, last = planner.optimize_generator(
            key=jax.random.PRNGKey(seed),
            epochs=8,
            train_seconds=1e300,
            print_summary=False,
            print_progress=False,
        )
        return {name: last[name] for name in ("params", "best_params", "sigma", "train_return")}

    plain = built(None)
    traced = trained(built(tmp_path / "programs"), 1)
    monkeypatch.setattr(stored_programs, "_export", None)  # a second trace would fail
    stored = built(tmp_path / "programs")
    for seed in (1, 2):
        expected, found = trained(plain, seed), trained(stored, seed)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5), found, expected)
        if seed == 1:
            assert_same_bits(found, traced)
    assert len(list((tmp_path / "programs").iterdir())) == 1
