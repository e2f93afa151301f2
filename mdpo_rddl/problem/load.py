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
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ply import lex, yacc
from pyRDDLGym.core.compiler.model import RDDLLiftedModel
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError
from pyRDDLGym.core.env import RDDLEnv
from pyRDDLGym.core.parser.nonfluents import NonFluents
from pyRDDLGym.core.parser.parser import RDDLlex, RDDLParser
from pyRDDLGym.core.parser.rddl import RDDL
from pyRDDLGym.core.simulator import RDDLSimulator

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.problem.blocks import Block, Outline, ignored, to_add
from mdpo_rddl.problem.files import COMMENT, ProblemFiles, read_problem
from mdpo_rddl.problem.functions import (
    Functions,
    FunctionsGiven,
    functions_of,
    require_functions,
)
from mdpo_rddl.problem.sizes import expression_text, oversize

logger = logging.getLogger(__name__)
_redirecting = threading.RLock()

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
    (`mdpo_rddl.problem.underlying`). `warnings` are about what stands in the files and has no
    effect, or hardly the one that was meant; whoever plans says them. `functions` are those in
    Python that the domain calls, whose file is part of the digest.
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
    warnings: tuple[str, ...] = field(default=(), repr=False)
    functions: Functions | None = field(default=None, repr=False)

    @property
    def horizon(self) -> int:
        """Number of decisions in an episode."""
        return self.model.horizon


def load_problem(
    domain: str,
    instance: str | None = None,
    horizon: int | None = None,
    tables: Path | None = None,
    functions: FunctionsGiven = None,
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
    functions: FunctionsGiven = None,
) -> Problem:
    """Parse and check the texts of a problem.

    A `horizon` replaces the instance's own. `tables` is a file that keeps the grammar's tables
    for the next run, a pickle that is trusted. `functions` are what the domain calls in Python: a
    file that has them, which is run, or they themselves by name. Two files of the user's must name
    the same domain and non-fluents.

    Raises `InputError` for whatever is wrong in the texts.
    """
    _check_horizon(horizon)
    domain_path, instance_path = files.domain_path, files.instance_path
    ast, without_effect = _parse(_parser(tables), files)
    if horizon is not None:
        ast.instance.horizon = horizon
    # Some pairs of rddlrepository disagree in their names, and still work.
    if files.is_own:
        _check_names(ast, domain_path, instance_path)
    _check_instance_block(ast, instance_path)
    own = functions_of(functions)
    require_functions(ast, own, domain_path)
    parts = [files.domain_text, files.instance_text]
    if own is not None and own.digest is not None:
        parts.append(own.digest)
    with _guarded(domain_path, instance_path):
        too_large = oversize(ast)
        if too_large is not None:
            raise _input_error(f"{instance_path}: {too_large}")
        _check_objects(ast, instance_path, without_effect)
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
        digest=hashlib.sha256("".join(parts).encode()).hexdigest(),
        functions=own,
    )
    broken = _try_one_step(problem)
    return replace(problem, warnings=(*without_effect, *broken))


def functions_by_name(problem: Problem) -> dict[str, Any]:
    """The Python functions that the domain calls, as pyRDDLGym and JaxPlan take them."""
    return {} if problem.functions is None else problem.functions.by_name


def make_environment(
    problem: Problem,
    enforce_action_constraints: bool = False,
    backend: type[RDDLSimulator] = RDDLSimulator,
) -> RDDLEnv:
    """Make an environment of its own (numpy simulator, vectorized) for a loaded problem.

    Environments of one problem share only its model. Raises `InputError` where the
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
                "python_functions": functions_by_name(problem),
            },
        )


class _Lexer(RDDLlex):
    """pyRDDLGym's lexer, which refuses an illegal character instead of skipping it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self.outline = path, Outline(path)
        self.build()

    def token(self) -> Any:
        """The next token, of which the outline hears."""
        token = super().token()
        if token is not None:
            self.outline.take(token)
        return token

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

    def parse_file(self, path: Path, text: str) -> "_File":
        """Return what the file holds. Raises `InputError` for a syntax error."""
        self._path = path
        self._text = COMMENT.sub("", text)
        self._non_fluents: list[NonFluents] = []
        self.lexer = _Lexer(path)
        with _guarded(path):
            try:
                blocks = self.parse(self._text)
            except KeyError as error:
                missing = str(error.args[0])
                where = self.lexer.outline.blocks[-1:]
                whose = "".join(f" of {block.kind} {block.name}" for block in where)
                raise _input_error(
                    f"{path}: the section {missing}{whose} is missing{to_add(missing)}"
                ) from error
        return _File(blocks, self._non_fluents, self.lexer.outline.blocks)

    def p_nonfluent_block(self, p: Any) -> None:
        super().p_nonfluent_block(p)
        self._non_fluents.append(p[0][1])

    # ply reads the grammar there
    p_nonfluent_block.__doc__ = RDDLParser.p_nonfluent_block.__doc__

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


class _File(NamedTuple):
    """A file that was parsed.

    Attributes:
      parsed: by kind the last block of it, pyRDDLGym's.
      non_fluents: all blocks of that kind.
      blocks: where they stand.
    """

    parsed: dict[str, Any]
    non_fluents: list[NonFluents]
    blocks: list[Block]

    def last(self, kind: str) -> Block | None:
        """Where the block stands that pyRDDLGym keeps of a kind."""
        return next((each for each in reversed(self.blocks) if each.kind == kind), None)


def _parse(parser: _Parser, files: ProblemFiles) -> tuple[RDDL, list[str]]:
    """Parse both files, and say what in them has no effect.

    Raises `InputError` for a syntax error or a missing block.
    """
    domain_path, instance_path = files.domain_path, files.instance_path
    is_one = domain_path == instance_path and files.domain_text == files.instance_text
    of_domain = parser.parse_file(domain_path, files.domain_text)
    of_instance = of_domain if is_one else parser.parse_file(instance_path, files.instance_text)
    _require_domain(of_domain, domain_path, is_one)
    _require_instance(of_instance, instance_path, of_domain.parsed["domain"].name)
    blocks = {**of_instance.parsed, "domain": of_domain.parsed["domain"]}
    counting = [of_domain.last("domain"), of_instance.last("instance")]
    where = _choose_non_fluents(blocks, [of_domain] if is_one else [of_domain, of_instance])
    if "non_fluents" not in blocks:
        name = getattr(blocks["instance"], "non_fluents", None)
        line = f"non-fluents {name or 'nf'} {{ domain = {blocks['domain'].name}; }}"
        and_name = "" if name else " and, in the instance, `non-fluents = nf;`"
        raise _input_error(
            f"{instance_path}: the file has no non-fluents block: add `{line}`{and_name}"
        )
    known = [each for each in (*counting, where) if each is not None]
    all_blocks = [*of_domain.blocks, *([] if is_one else of_instance.blocks)]
    return RDDL(blocks), list(ignored(all_blocks, known))


def _choose_non_fluents(blocks: dict[str, Any], files: list[_File]) -> Block | None:
    """Put the non-fluents in that the instance is for; say where they stand.

    None of the files' blocks is where the instance has its own, or there is none.
    """
    wanted = getattr(blocks["instance"], "non_fluents", None)
    own = blocks.get("non_fluents")
    given = [each for file in files for each in file.non_fluents]
    if own is not None and own.name == wanted and all(own is not each for each in given):
        return None
    if not given:
        return None
    chosen = next((each for each in reversed(given) if each.name == wanted), given[-1])
    blocks["non_fluents"] = chosen
    places = [each for file in files for each in file.blocks if each.kind == "non-fluents"]
    return next(place for place, each in zip(places, given, strict=True) if each is chosen)


def _require_domain(file: _File, path: Path, is_one: bool) -> None:
    if "domain" in file.parsed:
        return
    hint = ": it begins with `domain NAME {`"
    if "instance" in file.parsed:
        hint = " but an instance block: are the two files swapped?"
        if is_one:
            hint = ": give the domain's file before it"
    raise _input_error(f"{path}: the domain file has no domain block{hint}")


def _require_instance(file: _File, path: Path, domain: str) -> None:
    if "instance" in file.parsed:
        return
    line = f"instance NAME {{ domain = {domain}; non-fluents = NF; horizon = 40; discount = 1.0; }}"
    hint = f": add `{line}`"
    if "domain" in file.parsed:
        hint = " but a domain block: are the two files swapped?"
    raise _input_error(f"{path}: the instance file has no instance block{hint}")


def _check_objects(ast: RDDL, instance_path: Path, without_effect: Sequence[str]) -> None:
    """Raise `InputError` if a type has no objects."""
    given = dict(getattr(ast.non_fluents, "objects", None) or ())
    for name, kind in getattr(ast.domain, "types", None) or ():
        if kind == "object" and not given.get(name):
            why = "".join(f" ({each})" for each in without_effect if ": the objects of" in each)
            raise _input_error(
                f"{instance_path}: the type {name} has no objects: add `objects {{ {name} : "
                f"{{{name}1}}; }};` to the non-fluents block {ast.non_fluents.name}{why}"
            )


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
            raise _input_error(
                f"{instance_path}: instance '{ast.instance.name}' has no {section}{to_add(section)}"
            )
    if not _is_positive_int(ast.instance.horizon):
        raise _input_error(
            f"{instance_path}: the horizon must be a positive integer, got {ast.instance.horizon}"
        )


def _check_horizon(horizon: object) -> None:
    if horizon is not None and not _is_positive_int(horizon):
        raise _input_error(f"--horizon must be a positive integer, got {horizon!r}")


def _is_positive_int(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def _try_one_step(problem: Problem) -> list[str]:
    """Evaluate every expression once. Raises `InputError` where the simulator rejects one.

    The simulator finds an undefined fluent when it is built, but an unknown function or an
    operand of the wrong type only when it evaluates the expression.

    Returns a warning if the initial state breaks a state invariant.
    """
    env = make_environment(problem)
    with _guarded(problem.domain_path, problem.instance_path):
        env.reset(seed=0)
        sampler, broken = env.sampler, list[str]()
        if not sampler.check_state_invariants(silent=True):
            broken.append(_broken_start(problem, sampler))
        is_legal = sampler.check_action_preconditions(sampler.noop_actions, silent=True)
        if env.done:
            return broken
        try:
            env.step({})
        except RDDLValueOutOfRangeError:
            # of an action that is never played; a legal one may have values
            if is_legal:
                raise
    return broken


def _broken_start(problem: Problem, sampler: RDDLSimulator) -> str:
    """That the initial state breaks an invariant, and which."""
    each = problem.model.invariants
    broken = next(one for one in each if not bool(sampler._sample(one, sampler.subs)))
    return (
        f"{problem.instance_path}: the initial state breaks the state invariant "
        f"{expression_text(broken)}: an episode ends at its first step unless that mends it"
    )


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
        raise _input_error(f"{_named(paths)}: {message}") from error
    except Exception as error:  # Its errors have no common base, and some are accidents.
        is_own = type(error).__module__.startswith("pyRDDLGym")
        cause = str(error) if is_own else f"{type(error).__name__}: {error}"
        raise _input_error(f"{_named(paths)}: {cause}") from error
    for message in [*printed.getvalue().splitlines(), *(str(each.message) for each in caught)]:
        logger.debug("pyRDDLGym: %s", message)


def _named(paths: Iterable[Path]) -> str:
    """The files, each once: one may hold both blocks."""
    return ", ".join(dict.fromkeys(map(str, paths)))


def _input_error(message: str) -> InputError:
    return InputError(_LINE_BREAK.sub(" ", message.strip()))
