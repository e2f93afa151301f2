"""Which module may know which: read from the imports, without importing anything."""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "mdpo_rddl"
FILES = sorted(PACKAGE.rglob("*.py"))
MAX_LINES = 350

# what knows nothing of planners or RDDL
PURE = ("mdpo_rddl.noise", "mdpo_rddl.projection", "mdpo_rddl.actions")


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path) -> set[str]:
    """Absolute names of all that a file imports, wherever in it: modules and what is in them."""
    package = module_name(path).split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            names |= {source} | {f"{source}.{alias.name}" for alias in node.names}
    return names


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


def calls(path: Path) -> set[str]:
    """Names of all functions and methods that a file calls."""
    functions = {
        node.func
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
    }
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
    assert [(module_name(path), name) for path in FILES for name in calls(path) & hidden] == []


# --- the arrows ----------------------------------------------------------------------------


def test_noise_and_projection_know_only_jax_numpy_and_each_other():
    allowed = ("jax", "numpy", *sys.stdlib_module_names, *PURE)
    paths = modules(*PURE)
    names = [(module_name(path), name) for path in paths for name in imports(path)]
    assert [(module, name) for module, name in names if not is_of(name, *allowed)] == []
    assert {name for _, name in names} >= {"jax", "numpy", "mdpo_rddl.actions.ActionSpec"}


def test_only_jaxplan_imports_jaxplan():
    importers = {name for name, _ in violations(FILES, "pyRDDLGym_jax")}
    assert importers
    assert all(is_of(name, "mdpo_rddl.jaxplan") for name in importers)


def test_evaluation_knows_no_planner():
    paths = modules("mdpo_rddl.evaluation", "mdpo_rddl.problem")
    assert violations(paths, "jax", "mdpo_rddl.jaxplan", "mdpo_rddl.noise") == []


def test_the_core_imports_neither_experiments_nor_runs_nor_commands():
    outer = ("mdpo_rddl.experiments", "mdpo_rddl.ipc", "mdpo_rddl.cli")
    core = [path for path in FILES if not is_of(module_name(path), *outer)]
    names = {module_name(path) for path in core}
    assert names >= {f"mdpo_rddl.{name}" for name in ("training", "evaluation", "planning")}
    assert violations(core, *outer) == []


def test_experiments_do_not_know_the_competition():
    assert violations(modules("mdpo_rddl.experiments"), "mdpo_rddl.ipc") == []


def test_executors_know_nothing_of_the_work():
    names = {name for path in modules("mdpo_rddl.executors") for name in imports(path)}
    ours = {name for name in names if is_of(name, "mdpo_rddl")}
    assert all(is_of(name, "mdpo_rddl.executors", "mdpo_rddl.errors") for name in ours)


def test_nothing_but_the_commands_imports_the_commands():
    others = [path for path in FILES if not is_of(module_name(path), "mdpo_rddl.cli")]
    assert violations(others, "mdpo_rddl.cli") == []


# --- habits --------------------------------------------------------------------------------


def test_only_the_commands_print():
    printing = {module_name(path) for path in FILES if "print" in calls(path)}
    assert "mdpo_rddl.cli.bench" in printing
    assert all(is_of(name, "mdpo_rddl.cli") for name in printing)


def test_a_file_can_be_read_in_one_sitting():
    lengths = {module_name(path): len(path.read_text().splitlines()) for path in FILES}
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def test_nothing_unpickles_what_may_come_from_anyone():
    # as a policy file may; the cache and a child's pipe come from the package itself
    own = {
        "mdpo_rddl.stored_programs",
        "mdpo_rddl.session.second_evaluator",
        "mdpo_rddl.auto.alternatives",
    }
    unsafe = ("pickle", "cPickle", "dill", "joblib", "shelve", "marshal", "cloudpickle")
    everything = [*FILES, *sorted((ROOT / "tests").glob("*.py"))]
    assert {name for name, _ in violations(everything, *unsafe)} == own
    for path in everything:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant), path
                assert node.value.value is False, path
