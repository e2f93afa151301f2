"""The package's source as its tests read it, without importing anything."""

import ast
import functools
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "mdpo_rddl"
FILES = sorted(PACKAGE.rglob("*.py"))


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
