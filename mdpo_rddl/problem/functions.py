"""Python functions that a domain calls, as in `$name[_](x)`: pyRDDLGym's `python_functions`."""

import contextlib
import functools
import hashlib
import runpy
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyRDDLGym.core.parser.expr import Expression
from pyRDDLGym.core.parser.rddl import RDDL

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.files import read_bounded

MOST_BYTES = 2**20
"""Of a file of functions."""

Function = Callable[..., Any]


class FunctionError(InputError):
    """A function fails, or cannot be compiled; the message names its file, if it has one."""


@dataclass(frozen=True, eq=False)
class Functions:
    """Functions by the names that a domain calls them by.

    Attributes:
      given: as they were given; pure, and written with `jax.numpy` if the model is to be compiled.
      path: of the file that they are from; None if they are from no file.
      digest: sha256 (hex) of the file; None likewise.
    """

    given: Mapping[str, Function] = field(repr=False)
    path: Path | None = None
    digest: str | None = None

    @functools.cached_property
    def by_name(self) -> dict[str, Function]:
        """The same, of which any error is an `InputError` that names file and function."""
        return {name: self._told(name, function) for name, function in self.given.items()}

    def _told(self, name: str, function: Function) -> Function:
        where = "" if self.path is None else f"{self.path}: "

        def call(*inputs: Any) -> Any:
            try:
                return function(*inputs)
            except InputError:
                raise
            except Exception as error:
                kind = type(error)
                if kind.__module__.startswith("jax"):
                    raise FunctionError(
                        f"{where}the function {name} cannot be compiled ({kind.__name__}): write "
                        "it with jax.numpy, jnp.where in place of `if`, and no numpy or math"
                    ) from error
                cause = f"{kind.__name__}: {one_line_cause(error)}"
                raise FunctionError(f"{where}the function {name} fails: {cause}") from error

        return call


FunctionsGiven = Functions | Mapping[str, Function] | str | Path | None
"""How functions may be given: a Python file that has them, or they themselves by name."""


def functions_of(given: FunctionsGiven) -> Functions | None:
    """The functions of a file, or those that are given by name.

    Raises:
      InputError: naming the file, if it cannot be read or run; or if what is given is neither.
    """
    if given is None or isinstance(given, Functions):
        return given
    if isinstance(given, str | Path):
        return _read(Path(given))
    if not isinstance(given, Mapping) or not all(map(callable, given.values())):
        raise InputError(
            "functions must be a Python file, or functions by name, got " + type(given).__name__
        )
    return Functions(dict(given))


def _read(path: Path) -> Functions:
    """Runs a file, as an import would, for the functions that it has."""
    try:
        content = read_bounded(path, MOST_BYTES)
    except (OSError, ValueError) as error:
        cause = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot read the file of functions: {cause}") from error
    digest = hashlib.sha256(content).hexdigest()
    try:
        with _importing_from(path.resolve().parent):
            found = runpy.run_path(str(path), run_name=f"mdpo_rddl_functions_{digest[:16]}")
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [at.lineno for at in frames if at.filename == str(path)]
        line = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else None
        where = f"{path}:{line}" if line else f"{path}"
        cause = f"{type(error).__name__}: {one_line_cause(str(error))}"
        raise InputError(f"{where}: the file of functions cannot be run: {cause}") from error
    public = {n: each for n, each in found.items() if callable(each) and n[0] != "_"}
    return Functions(public, path, digest)


@contextlib.contextmanager
def _importing_from(folder: Path) -> Iterator[None]:
    """A file may import those beside it, as a script may."""
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.path.remove(str(folder))


def require_functions(ast: RDDL, functions: Functions | None, domain: Path) -> None:
    """Raises `InputError` unless all functions are there that a domain calls.

    Args:
      ast: both files, parsed.
      functions: what is there.
      domain: where the domain lies, for the message.
    """
    for name in called_functions(ast):
        if functions is None:
            raise InputError(
                f"{domain}: calls the Python function ${name}: give the file that has it, "
                "with --functions FILE.py or functions="
            )
        if name not in functions.given:
            where = "functions" if functions.path is None else f"{functions.path}"
            known = ", ".join(sorted(functions.given)) or "none"
            raise InputError(
                f"{where}: it has no function {name}, which {domain} calls; it has: {known:.200}"
            )


def called_functions(ast: RDDL) -> list[str]:
    """The names of the Python functions that a domain calls, each once.

    Args:
      ast: both files, parsed.
    """
    domain, found = ast.domain, list[str]()
    waiting: list[Any] = [
        [cpf.expr for cpf in domain.cpfs[1]],
        domain.reward,
        *(getattr(domain, name, None) or [] for name in ("preconds", "invariants", "terminals")),
    ]
    while waiting:  # no recursion: expressions may be nested as deep as anybody likes
        node = waiting.pop()
        if isinstance(node, Expression):
            node = node._expr
            if isinstance(node, tuple) and node and node[0] == "pyfunc":
                found.append(str(node[1][0]))
            waiting.append(node)
        elif isinstance(node, list | tuple):
            waiting += node
    return sorted(set(found))
