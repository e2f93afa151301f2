"""Loads an RDDL problem, and turns every mistake in it into a one-line `InputError`.

pyRDDLGym joins the two files and strips their comments before it parses them, so that its
line numbers fit neither file. Here each file is parsed on its own, with pyRDDLGym's grammar.
"""

import contextlib
import hashlib
import io
import logging
import re
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ply import lex, yacc
from pyRDDLGym.core.compiler.model import RDDLLiftedModel
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError
from pyRDDLGym.core.env import RDDLEnv
from pyRDDLGym.core.parser.parser import RDDLlex, RDDLParser
from pyRDDLGym.core.parser.rddl import RDDL
from pyRDDLGym.core.simulator import RDDLSimulator

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.problem.files import COMMENT, ProblemFiles, read_problem
from mdpo_rddl.problem.sizes import oversize

logger = logging.getLogger(__name__)
_redirecting = threading.RLock()

Functions = Mapping[str, Callable[..., Any]]
"""External Python functions that a domain calls, by name."""

_UNDECODABLE = "\ufffd"
_LINE_BREAK = re.compile(r"\s*[\r\n]+\s*")


@dataclass(frozen=True)
class Problem:
    """A parsed RDDL problem.

    `label` is a short name for folders and tables: the stem of the instance file, or
    '<Domain>-<instance>' for a problem of rddlrepository. The texts are those of the two files,
    with Unix line ends, and `digest` is the sha256 (hex) of one followed by the other. `raises`
    says that the environment was seen to raise an error in play, which policies must avoid;
    `error_cost` is what its reward has less at each step at which it would
    (`mdpo_rddl.problem.underlying`).
    """

    model: RDDLLiftedModel = field(repr=False)
    domain_name: str
    instance_name: str
    label: str
    domain_path: Path
    instance_path: Path
    domain_text: str = field(repr=False)
    instance_text: str = field(repr=False)
    digest: str
    raises: bool = False
    error_cost: float = 0.0

    @property
    def horizon(self) -> int:
        """Number of decisions in an episode."""
        return self.model.horizon


def load_problem(
    domain: str,
    instance: str | None = None,
    horizon: int | None = None,
    tables: Path | None = None,
    functions: Functions | None = None,
) -> Problem:
    """Parse and check a problem: two files, two names of rddlrepository, or a shipped one's name.

    The arguments are those of `mdpo_rddl.problem.files.read_problem`, and the others those of
    `parse_problem`.

    Raises `InputError` for whatever is wrong with the arguments or in the files.
    """
    _check_horizon(horizon)
    return parse_problem(read_problem(domain, instance), horizon, tables, functions)


def parse_problem(
    files: ProblemFiles,
    horizon: int | None = None,
    tables: Path | None = None,
    functions: Functions | None = None,
) -> Problem:
    """Parse and check the texts of a problem.

    A `horizon` replaces the instance's own. `tables` is a file that keeps the grammar's tables
    for the next run, a pickle that is trusted. `functions` are those that the domain calls. Two
    files of the user's must name the same domain and non-fluents.

    Raises `InputError` for whatever is wrong in the texts.
    """
    _check_horizon(horizon)
    domain_path, instance_path = files.domain_path, files.instance_path
    ast = _parse(_parser(tables), files)
    if horizon is not None:
        ast.instance.horizon = horizon
    # Some pairs of rddlrepository disagree in their names, and still work.
    if files.is_own:
        _check_names(ast, domain_path, instance_path)
    _check_instance_block(ast, instance_path)
    with _guarded(domain_path, instance_path):
        too_large = oversize(ast)
        if too_large is not None:
            raise _input_error(f"{instance_path}: {too_large}")
        model = RDDLLiftedModel(ast)
    problem = Problem(
        model=model,
        domain_name=ast.domain.name,
        instance_name=ast.instance.name,
        label=files.label,
        domain_path=domain_path,
        instance_path=instance_path,
        domain_text=files.domain_text,
        instance_text=files.instance_text,
        digest=hashlib.sha256((files.domain_text + files.instance_text).encode()).hexdigest(),
    )
    _try_one_step(problem, functions)
    return problem


def make_environment(
    problem: Problem,
    enforce_action_constraints: bool = False,
    backend: type[RDDLSimulator] = RDDLSimulator,
    functions: Functions | None = None,
) -> RDDLEnv:
    """Make an environment of its own (numpy simulator, vectorized) for a loaded problem.

    Environments of one problem share only its model. `functions` are those that its domain calls.
    Raises `InputError` where the
    simulator rejects the problem.
    """
    with _guarded(problem.domain_path, problem.instance_path):
        return RDDLEnv(
            domain=problem.model,
            instance=None,
            enforce_action_constraints=enforce_action_constraints,
            vectorized=True,
            backend=backend,
            # The simulator's default generator is one object that all simulators share.
            backend_kwargs={
                "rng": np.random.default_rng(),
                **({} if functions is None else {"python_functions": dict(functions)}),
            },
        )


class _Lexer(RDDLlex):
    """pyRDDLGym's lexer, which refuses an illegal character instead of skipping it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self.build()

    def t_error(self, t: lex.LexToken) -> None:
        character = t.value[0]
        is_decoded = character != _UNDECODABLE
        cause = f"illegal character {character!r}" if is_decoded else "not UTF-8 text"
        raise _input_error(f"{self._path}:{t.lineno}: {cause}")


class _Parser(RDDLParser):
    """pyRDDLGym's grammar, applied to one file at a time."""

    def __init__(self, tables: Path | None) -> None:
        super().__init__()
        # Without these options ply writes files next to the module of this class.
        options = {"start": "rddl_block", "debug": False, "write_tables": False}
        options["errorlog"] = yacc.NullLogger()
        if tables is None:
            self.build(**options)
            return
        with contextlib.suppress(Exception):  # whatever a damaged file makes pickle raise
            if tables.is_file():
                self.build(picklefile=str(tables), **options)
                return
        with tempfile.TemporaryDirectory() as folder:
            fresh = Path(folder) / tables.name
            self.build(picklefile=str(fresh), **options)
            with contextlib.suppress(InputError):  # a full or read-only disk
                write_atomically(tables, fresh.read_bytes())

    def parse_file(self, path: Path, text: str) -> dict[str, Any]:
        """Return the file's blocks by kind. Raises `InputError` for a syntax error."""
        self._path = path
        self._text = COMMENT.sub("", text)
        self.lexer = _Lexer(path)
        with _guarded(path):
            try:
                return self.parse(self._text)
            except KeyError as error:
                raise _input_error(f"{path}: the section {error.args[0]} is missing") from error

    def p_error(self, p: lex.LexToken | None) -> None:
        before = (self._text if p is None else self._text[: p.lexpos]).rstrip()
        line_before = before.count("\n") + 1
        if p is None:
            raise _input_error(
                f"{self._path}:{line_before}: syntax error: the file ends inside a block"
            )
        # The first word of a line is often right, and what is before it lacks an end.
        is_doubtful = before and line_before < p.lineno
        hint = f" (or at the end of line {line_before})" if is_doubtful else ""
        word = f"the keyword '{p.value}'" if p.type in self.reverse_tokens else f"'{p.value}'"
        raise _input_error(f"{self._path}:{p.lineno}: syntax error at {word}{hint}")


_of_thread = threading.local()


def _parser(tables: Path | None) -> _Parser:
    """The thread's parser: making the grammar's tables takes longer than reading most problems."""
    if not hasattr(_of_thread, "parser"):
        _of_thread.parser = _Parser(tables)
    parser: _Parser = _of_thread.parser
    return parser


def _parse(parser: _Parser, files: ProblemFiles) -> RDDL:
    """Parse both files. Raises `InputError` for a syntax error or a missing block."""
    domain_path, instance_path = files.domain_path, files.instance_path
    blocks = parser.parse_file(domain_path, files.domain_text)
    instance_blocks = parser.parse_file(instance_path, files.instance_text)
    _require_block(blocks, "domain", "instance", domain_path)
    _require_block(instance_blocks, "instance", "domain", instance_path)
    blocks = {**blocks, **instance_blocks, "domain": blocks["domain"]}
    if "non_fluents" not in blocks:
        raise _input_error(f"{instance_path}: the file has no non-fluents block")
    return RDDL(blocks)


def _require_block(blocks: dict[str, Any], kind: str, other: str, path: Path) -> None:
    if kind not in blocks:
        hint = f" but an {other} block: are the two files swapped?" if other in blocks else ""
        raise _input_error(f"{path}: the {kind} file has no {kind} block{hint}")


def _check_names(ast: RDDL, domain_path: Path, instance_path: Path) -> None:
    """Raise `InputError` if the instance belongs to another domain or non-fluents."""
    for block, subject in (
        (ast.instance, f"instance '{ast.instance.name}' is"),
        (ast.non_fluents, f"non-fluents '{ast.non_fluents.name}' are"),
    ):
        if getattr(block, "domain", ast.domain.name) != ast.domain.name:
            raise _input_error(
                f"{instance_path}: {subject} for domain '{block.domain}', "
                f"but {domain_path} defines '{ast.domain.name}'"
            )
    wanted = getattr(ast.instance, "non_fluents", ast.non_fluents.name)
    if wanted != ast.non_fluents.name:
        raise _input_error(
            f"{instance_path}: instance '{ast.instance.name}' is for non-fluents '{wanted}', "
            f"but the file defines '{ast.non_fluents.name}'"
        )


def _check_instance_block(ast: RDDL, instance_path: Path) -> None:
    """Raise `InputError` if the instance lacks a usable horizon or a discount."""
    for section in ("horizon", "discount"):
        if not hasattr(ast.instance, section):
            raise _input_error(f"{instance_path}: instance '{ast.instance.name}' has no {section}")
    if not _is_positive_int(ast.instance.horizon):
        raise _input_error(
            f"{instance_path}: the horizon must be a positive integer, got {ast.instance.horizon}"
        )


def _check_horizon(horizon: object) -> None:
    if horizon is not None and not _is_positive_int(horizon):
        raise _input_error(f"--horizon must be a positive integer, got {horizon!r}")


def _is_positive_int(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def _try_one_step(problem: Problem, functions: Functions | None) -> None:
    """Evaluate every expression once. Raises `InputError` where the simulator rejects one.

    The simulator finds an undefined fluent when it is built, but an unknown function or an
    operand of the wrong type only when it evaluates the expression.
    """
    env = make_environment(problem, functions=functions)
    with _guarded(problem.domain_path, problem.instance_path):
        env.reset(seed=0)
        is_legal = env.sampler.check_action_preconditions(env.sampler.noop_actions, silent=True)
        if env.done:
            return
        try:
            env.step({})
        except RDDLValueOutOfRangeError:
            # of an action that is never played; a legal one may have values
            if is_legal:
                raise


@contextlib.contextmanager
def _guarded(*paths: Path) -> Iterator[None]:
    """Log what pyRDDLGym prints or warns; turn what it raises into an `InputError`.

    One thread at a time: the redirection is the process's, and who ends it must have begun it.
    """
    printed = io.StringIO()
    try:
        with (
            _redirecting,
            warnings.catch_warnings(record=True) as caught,
            contextlib.redirect_stdout(printed),
        ):
            warnings.simplefilter("always")
            yield
    except InputError:
        raise
    except RecursionError as error:
        message = "an expression is nested too deeply, or a chain of operators is too long"
        raise _input_error(f"{', '.join(map(str, paths))}: {message}") from error
    except Exception as error:  # Its errors have no common base, and some are accidents.
        is_own = type(error).__module__.startswith("pyRDDLGym")
        cause = str(error) if is_own else f"{type(error).__name__}: {error}"
        raise _input_error(f"{', '.join(map(str, paths))}: {cause}") from error
    for message in [*printed.getvalue().splitlines(), *(str(each.message) for each in caught)]:
        logger.debug("pyRDDLGym: %s", message)


def _input_error(message: str) -> InputError:
    return InputError(_LINE_BREAK.sub(" ", message.strip()))
