"""Which module may know which: read from the imports, without importing anything."""

import ast
import functools
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "mdpo_rddl"
FILES = sorted(PACKAGE.rglob("*.py"))
MAX_LINES = 350

# the rooms, each with those that it may import from; `errors` is everybody's
ROOMS = {
    "machine": (),
    "noise": (),
    "problem": ("machine",),
    "planner": ("machine", "noise", "problem"),
    "policy": ("machine", "noise", "problem", "planner"),
    "auto": ("machine", "noise", "problem", "planner", "policy"),
    "session": ("machine", "noise", "problem", "planner", "policy", "auto"),
    "ipc": ("machine", "noise", "problem", "planner", "policy", "auto"),
    "bench": ("machine", "noise", "problem", "planner", "policy", "auto", "session", "ipc"),
}
# the command line imports from all of them
ALL_ROOMS = {*ROOMS, "cli"}
# what may lie beside the rooms
LOOSE = {"__init__.py", "errors.py", "py.typed"}


@functools.cache
def tree(path: Path) -> ast.Module:
    """A file's syntax tree, parsed once."""
    return ast.parse(path.read_text(encoding="utf-8"))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@functools.cache
def imports(path: Path) -> frozenset[str]:
    """Absolute names of all that a file imports, wherever in it: modules and what is in them."""
    package = module_name(path).split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    names: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            names |= {source} | {f"{source}.{alias.name}" for alias in node.names}
    return frozenset(names)


def is_of(name: str, *packages: str) -> bool:
    return any(name == package or name.startswith(package + ".") for package in packages)


def modules(*packages: str) -> list[Path]:
    found = [path for path in FILES if is_of(module_name(path), *packages)]
    assert found, f"no module of {packages}"
    return found


def violations(paths: list[Path], *forbidden: str) -> list[tuple[str, str]]:
    return [
        (module_name(path), name)
        for path in paths
        for name in sorted(imports(path))
        if is_of(name, *forbidden)
    ]


@functools.cache
def calls(path: Path) -> set[str]:
    """Names of all functions and methods that a file calls."""
    functions = {node.func for node in ast.walk(tree(path)) if isinstance(node, ast.Call)}
    return {getattr(function, "id", getattr(function, "attr", "")) for function in functions}


# --- the reading itself --------------------------------------------------------------------


def test_imports_are_found_in_every_form(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
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
    assert found == [("mdpo_rddl", "import_module")]


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


def test_the_machine_knows_no_rddl():
    assert violations(room("machine"), "pyRDDLGym", "rddlrepository") == []


def test_noise_knows_only_jax_and_numpy():
    allowed = ("jax", "numpy", *sys.stdlib_module_names, "mdpo_rddl.noise")
    names = [(module_name(path), name) for path in room("noise") for name in imports(path)]
    assert [(module, name) for module, name in names if not is_of(name, *allowed)] == []
    assert {name for _, name in names} >= {"jax", "numpy"}


def test_the_measurements_rooms_share_only_what_is_common():
    folder = PACKAGE / "bench"
    ends = {end for start, end in edges_inside(folder)}
    assert ends == {"common"}


def test_arms_see_each_other_only_through_their_interface():
    folder = PACKAGE / "auto" / "arms"
    # what an arm is, each of them more than the one before
    kinds = ["base", "compiling", "learning", "trained"]
    arms = {path.stem for path in folder.glob("*.py")} - {"__init__", *kinds}
    assert {"gradient", "plan_search", "jaxplan"} <= arms
    assert {end for _, end in edges_inside(folder)} == set(kinds)
    among = {(start, end) for start, end in edges_inside(folder) if start in kinds}
    assert among == {("compiling", "base"), ("learning", "compiling"), ("trained", "compiling")}
    # what several of them search with are no arms, and know none
    assert violations(room("auto.search"), "mdpo_rddl.auto.arms", "mdpo_rddl.auto.arena") == []


def test_a_race_asks_one_clock_for_the_time():
    # threads and a process of its own are waited for by the machine's clock
    asking = {
        module_name(path)
        for path in room("auto")
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Call) and ast.unparse(node.func).startswith("time.")
    }
    waiting = {"arms.compiling", "arms.jaxplan", "compilations"}
    assert asking == {f"mdpo_rddl.auto.{name}" for name in waiting}


def test_executors_know_nothing_of_the_work():
    names = {name for path in room("machine.executors") for name in imports(path)}
    ours = {name for name in names if is_of(name, "mdpo_rddl")}
    assert all(is_of(name, "mdpo_rddl.machine.executors", "mdpo_rddl.errors") for name in ours)


# --- habits --------------------------------------------------------------------------------


def test_only_the_commands_print():
    printing = {module_name(path) for path in FILES if "print" in calls(path)}
    assert "mdpo_rddl.cli.bench" in printing
    assert all(is_of(name, "mdpo_rddl.cli") for name in printing)


def test_a_file_can_be_read_in_one_sitting():
    lengths = {module_name(path): len(path.read_text().splitlines()) for path in FILES}
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def test_nothing_unpickles_what_may_come_from_anyone():
    # as a policy file may; the cache comes from the package itself, and the work that a child is
    # given from the process that has started it
    own = {"mdpo_rddl.planner.programs.stored", "mdpo_rddl.machine.guarded"}
    unsafe = ("pickle", "cPickle", "dill", "joblib", "shelve", "marshal", "cloudpickle")
    everything = [*FILES, *sorted((ROOT / "tests").rglob("*.py"))]
    assert {name for name, _ in violations(everything, *unsafe)} == own
    for path in everything:
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant), path
                assert node.value.value is False, path


def test_nothing_is_executed_that_was_read():
    # a literal of a configuration is none: `ast.literal_eval` makes values only
    executing = {"eval", "exec", "compile", "execfile", "system", "popen", "load_module"}
    found = {
        (module_name(path), ast.unparse(node.func))
        for path in FILES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).rpartition(".")[2] in executing
        and ast.unparse(node.func).rpartition(".")[0] in ("", "os", "builtins")
    }
    assert found == set()
    shells = [
        module_name(path)
        for path in FILES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.keyword) and node.arg == "shell"
    ]
    assert shells == []


def test_jaxplan_s_controller_that_unpickles_files_is_never_made():
    assert [module_name(path) for path in FILES if "JaxOfflineController" in calls(path)] == []


def test_files_from_anybody_are_read_through_the_one_door():
    # its own resources, a child's log, the tables and the programs of the user's own cache
    own = {
        "mdpo_rddl.bench.speed.growth",
        "mdpo_rddl.bench.tasks.published",
        "mdpo_rddl.machine.child",
        "mdpo_rddl.machine.files",
        "mdpo_rddl.machine.process_tree",
        "mdpo_rddl.planner.config.presets.by_domain",
        "mdpo_rddl.planner.programs.stored",
        "mdpo_rddl.problem.load",
        "mdpo_rddl.session.report.page.render",
    }
    reading = {"read_text", "read_bytes", "load_file", "safe_open", "loadtxt", "fromfile"}
    assert {module_name(path) for path in FILES if calls(path) & reading} <= own


def opens_to_read(node: ast.AST) -> bool:
    """Whether a file may be opened to be read: unless a mode is given that only writes."""
    if not isinstance(node, ast.Call):
        return False
    name = ast.unparse(node.func)
    if name.rpartition(".")[2] not in ("open", "fdopen"):
        return False
    # of a path the first word, of a name or a handle the second
    given = node.args[name in ("open", "io.open", "os.open", "os.fdopen") :]
    modes = [word.value for word in node.keywords if word.arg == "mode"] or given
    if not modes or not isinstance(modes[0], ast.Constant):
        return True
    return not {"w", "a", "x"} & set(str(modes[0].value)) or "+" in str(modes[0].value)


def test_opening_to_read_is_seen_in_every_form():
    found = {
        text: any(opens_to_read(node) for node in ast.walk(ast.parse(text)))
        for text in (
            "path.open()",
            "path.open(encoding='utf-8')",
            "(folder / 'a').open('rb')",
            "path.open(mode='r+b')",
            "open(path)",
            "io.open(path, mode)",
            "os.open(path, os.O_RDONLY)",
            "os.fdopen(handle, 'rb')",
            "path.open('a+b')",
            "path.open('w', newline='')",
            "open(path, 'ab')",
            "os.fdopen(handle, 'wb')",
            "path.open(mode='x')",
        )
    }
    assert list(found.values()) == [True] * 9 + [False] * 4


def test_no_file_is_opened_to_be_read_but_at_the_one_door():
    named = {
        "mdpo_rddl.machine.files",  # the door itself
        "mdpo_rddl.machine.child",  # a child's log, in a folder of its own
        "mdpo_rddl.machine.locks",  # a lock, nothing of which is read
        "mdpo_rddl.bench.common.records",  # says whether rows can be added, and reads none
        "mdpo_rddl.session.report.run_folder",  # puts on the disk what was written
        "mdpo_rddl.cli.ending",  # the device that swallows what nobody reads
    }
    found = {
        module_name(path)
        for path in FILES
        if any(opens_to_read(node) for node in ast.walk(tree(path)))
    }
    assert found == named


def test_pictures_are_drawn_into_memory_or_a_run_that_is_not_there_yet():
    # `write_picture` puts them at their place in one step
    drawing = {
        "mdpo_rddl.machine.pictures",
        "mdpo_rddl.ipc.figures",
        "mdpo_rddl.session.report.figures",
        "mdpo_rddl.session.report.race_figure",
        "mdpo_rddl.session.report.page.style",
    }
    assert {module_name(path) for path in FILES if "savefig" in calls(path)} == drawing


def test_no_file_chooses_how_a_notebook_draws():
    # pyplot picks a backend for the whole process; `Figure` objects do not
    assert violations(FILES, "matplotlib.pyplot", "matplotlib.use", "pylab") == []
    assert {name for path in FILES for name in imports(path)} >= {"matplotlib.figure.Figure"}
    using = [path for path in FILES if "matplotlib" in imports(path) and "use" in calls(path)]
    assert using == []
