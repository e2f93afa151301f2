"""Which module may know which: read from the imports, without importing anything."""

import subprocess
import sys
from pathlib import Path

import pytest
from helpers import sources
from helpers.sources import (
    FILES,
    PACKAGE,
    calls,
    imports,
    is_of,
    module_name,
    modules,
    violations,
)

# the rooms, each with those that it may import from; `errors` is everybody's
ROOMS = {
    "machine": (),
    "noise": (),
    "problem": ("machine",),
    "simulator": ("machine", "problem"),
    "planner": ("machine", "noise", "problem"),
    "policy": ("machine", "noise", "problem", "planner", "simulator"),
    "race": ("machine", "noise", "problem", "simulator", "planner", "policy"),
    "session": ("machine", "noise", "problem", "simulator", "planner", "policy", "race"),
    "ipc": ("machine", "noise", "problem", "planner", "policy", "race"),
}
# the command line imports from all of them
ALL_ROOMS = {*ROOMS, "cli"}
# beside the package: what is measured, and those of its files that know it all
BENCHMARKS, COMMANDS = PACKAGE.parent / "benchmarks", {"__main__", "commands", "main"}
# what may lie beside the rooms
LOOSE = {"__init__.py", "errors.py", "py.typed"}


# --- the reading itself --------------------------------------------------------------------


def test_imports_are_found_in_every_form(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "ROOT", tmp_path)
    path = tmp_path / "pack" / "sub" / "module.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        "import one.two as three, four\n"
        "from five.six import seven\n"
        "from . import eight\n"
        "from ..nine import ten\n"
        "def late():\n"
        "    from eleven import twelve\n"
        "if True:\n"
        "    import thirteen\n"
    )
    plain = {"one.two", "four", "five.six", "five.six.seven", "eleven", "eleven.twelve"}
    relative = {"pack.sub", "pack.sub.eight", "pack.nine", "pack.nine.ten"}
    assert imports(path) == plain | relative | {"thirteen"}
    path.with_name("__init__.py").write_text("from .module import late\n")
    assert imports(path.with_name("__init__.py")) == {"pack.sub.module", "pack.sub.module.late"}
    assert is_of("pack.sub", "pack")
    assert not is_of("package", "pack")


def test_the_package_is_where_it_is_looked_for():
    assert {"mdpo_rddl", "mdpo_rddl.noise.draws", "mdpo_rddl.cli.plan"} <= set(
        map(module_name, FILES)
    )


def test_imports_are_written_as_statements():
    hidden = {"__import__", "import_module", "exec", "eval"}
    found = [(module_name(path), name) for path in FILES for name in calls(path) & hidden]
    # the public names, which type checkers read as statements
    assert found == [("mdpo_rddl", "import_module"), ("mdpo_rddl.noise", "import_module")]


# --- the arrows ----------------------------------------------------------------------------


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def room(*names: str) -> list[Path]:
    return modules(*(f"mdpo_rddl.{name}" for name in names))


def edges_inside(folder: Path) -> set[tuple[str, str]]:
    """Which entry of a folder imports from which other one, both by their names in it."""
    prefix = module_name(folder / "__init__.py").split(".")
    depth = len(prefix)
    found = set()
    for path in sorted(folder.rglob("*.py")):
        inside = path.relative_to(folder).parts[0].removesuffix(".py")
        if inside == "__init__":
            continue
        for name in imports(path):
            parts = name.split(".")
            if parts[:depth] == prefix and len(parts) > depth and parts[depth] != inside:
                found.add((inside, parts[depth]))
    names = {entry.name.removesuffix(".py") for entry in folder.iterdir()}
    return {edge for edge in found if set(edge) <= names}


def cycle(edges: set[tuple[str, str]]) -> list[str]:
    """Nodes that reach themselves."""
    after: dict[str, set[str]] = {}
    for start, end in edges:
        after.setdefault(start, set()).add(end)
    reached = {node: set(ends) for node, ends in after.items()}
    for _ in after:
        for ends in reached.values():
            ends |= set().union(*(after.get(end, set()) for end in ends))
    return sorted(node for node, ends in reached.items() if node in ends)


def test_a_cycle_is_seen():
    assert cycle({("a", "b"), ("b", "c"), ("c", "a"), ("d", "a")}) == ["a", "b", "c"]
    assert cycle({("a", "b"), ("b", "c"), ("a", "c")}) == []


def test_there_are_ten_rooms_and_nothing_beside_them():
    entries = {path.name for path in PACKAGE.iterdir() if path.name != "__pycache__"}
    assert entries - LOOSE == ALL_ROOMS
    assert len(ALL_ROOMS) <= 10


@pytest.mark.parametrize("name", ROOMS)
def test_a_room_imports_only_from_those_below_it(name):
    above = ALL_ROOMS - {name, *ROOMS[name]}
    assert violations(room(name), *(f"mdpo_rddl.{other}" for other in above)) == []


@pytest.mark.parametrize(
    "folder", [PACKAGE, *sorted(path.parent for path in PACKAGE.glob("*/**/__init__.py"))], ids=str
)
def test_imports_go_one_way_inside_a_room_too(folder):
    assert cycle(edges_inside(folder)) == []


def test_only_the_planner_imports_jaxplan():
    importers = {name for name, _ in violations(FILES, "pyRDDLGym_jax")}
    assert importers
    assert all(is_of(name, "mdpo_rddl.planner") for name in importers)


def test_the_problem_knows_no_jax():
    assert violations(room("problem"), "jax", "mdpo_rddl.machine.jax_setup") == []


def test_the_simulator_knows_no_jax():
    assert violations(room("simulator"), "jax", "mdpo_rddl.machine.jax_setup") == []


def test_races_and_policies_begin_without_jax():
    program = (
        "import sys, mdpo_rddl.race.race, mdpo_rddl.policy.load, mdpo_rddl.session.plan; "
        "print({'jax', 'pyRDDLGym_jax'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout.strip() == "set()", run.stderr


def test_the_machine_knows_no_rddl():
    assert violations(room("machine"), "pyRDDLGym", "rddlrepository") == []


def test_noise_knows_only_jax_and_numpy():
    allowed = ("jax", "numpy", *sys.stdlib_module_names, "mdpo_rddl.noise")
    names = [(module_name(path), name) for path in room("noise") for name in imports(path)]
    assert [(module, name) for module, name in names if not is_of(name, *allowed)] == []
    assert {name for _, name in names} >= {"jax", "numpy"}


def test_the_measurements_rooms_share_only_what_is_common():
    edges = {(start, end) for start, end in edges_inside(BENCHMARKS) if start not in COMMANDS}
    assert {end for _, end in edges} == {"common"}


def test_the_package_knows_no_measurements():
    assert violations(FILES, "benchmarks") == []


def test_arms_do_not_know_each_other():
    folder = PACKAGE / "race" / "arms"
    among = {(start, end) for start, end in edges_inside(folder) if start != "__init__"}
    # one idea in three files
    assert among == {("plans", "plan_archive"), ("plans", "plan_mutations")}
    arms = violations(room("race"), "mdpo_rddl.race.arms")
    assert {name for name, _ in arms if not is_of(name, "mdpo_rddl.race.arms")} <= {
        "mdpo_rddl.race.race"
    }


def test_executors_know_nothing_of_the_work():
    names = {name for path in room("machine.executors") for name in imports(path)}
    ours = {name for name in names if is_of(name, "mdpo_rddl")}
    assert all(is_of(name, "mdpo_rddl.machine.executors", "mdpo_rddl.errors") for name in ours)


# --- habits --------------------------------------------------------------------------------


def test_only_the_commands_print():
    printing = {module_name(path) for path in FILES if "print" in calls(path)}
    assert "mdpo_rddl.cli.plan" in printing
    assert all(is_of(name, "mdpo_rddl.cli") for name in printing)


def test_pictures_are_drawn_into_memory_or_a_run_that_is_not_there_yet():
    # `write_picture` puts them at their place in one step
    drawing = {
        "mdpo_rddl.machine.pictures",
        "mdpo_rddl.ipc.figures",
        "mdpo_rddl.session.report.figures",
        "mdpo_rddl.session.report.race_figure",
    }
    assert {module_name(path) for path in FILES if "savefig" in calls(path)} == drawing


def test_no_file_chooses_how_a_notebook_draws():
    # pyplot picks a backend for the whole process; `Figure` objects do not
    assert violations(FILES, "matplotlib.pyplot", "matplotlib.use", "pylab") == []
    assert {name for path in FILES for name in imports(path)} >= {"matplotlib.figure.Figure"}
    using = [path for path in FILES if "matplotlib" in imports(path) and "use" in calls(path)]
    assert using == []
