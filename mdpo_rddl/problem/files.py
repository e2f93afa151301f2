"""Finds and reads the two files of a problem; quick to import, so that a mistake is soon said."""

import difflib
import os
import re
from dataclasses import dataclass
from pathlib import Path

from mdpo_rddl.errors import InputError, printable
from mdpo_rddl.machine.files import decoded, read_bounded
from mdpo_rddl.problem.repository import rddl_repository
from mdpo_rddl.problem.shipped import shipped_files, shipped_names

MOST_RDDL_BYTES = 2**20
"""Of one file; parsing that much takes about ten seconds."""

COMMENT = re.compile(r"//[^\n]*")
"""Of a domain or an instance, to the end of its line."""

_INSTANCE = re.compile(r"\binstance\s+[^\s{]+\s*\{")
_LIST = "mdpo-plan --list shows all"


@dataclass(frozen=True)
class ProblemFiles:
    """The files of a problem, as they are read.

    Attributes:
      domain_path, instance_path: where they lie.
      domain_text, instance_text: what they hold, with Unix line ends.
      label: a short name: the stem of the instance file, or '<Domain>-<instance>' for a problem
        of rddlrepository.
      is_own: whether the user named the files; else they are rddlrepository's.
    """

    domain_path: Path
    instance_path: Path
    domain_text: str
    instance_text: str
    label: str
    is_own: bool


def read_problem(domain: str, instance: str | None = None) -> ProblemFiles:
    """Finds a problem and reads its files.

    Args:
      domain: a file, or a name of rddlrepository; without an instance the name of a problem that
        comes with the package, or a file that holds the instance, too.
      instance: a file, or the name of an instance. Both are files if either looks like one: it
        has a path separator or the suffix .rddl, or it exists.

    Raises:
      InputError: naming the argument, if there is no such problem or a file cannot be read.
    """
    is_own = instance is None or looks_like_file(domain) or looks_like_file(instance)
    if instance is None:
        domain_path, instance_path = _paths_of_one(domain)
    elif is_own:
        domain_path, instance_path = Path(domain), Path(instance)
    else:
        domain_path, instance_path = _repository_paths(domain, instance)
    domain_text = _read_text(domain_path, "domain")
    is_single = instance is None and domain_path == instance_path
    if is_single and not _INSTANCE.search(COMMENT.sub("", domain_text)):
        raise InputError(f"{domain}: which instance? Give its file too")
    return ProblemFiles(
        domain_path=domain_path,
        instance_path=instance_path,
        domain_text=domain_text,
        instance_text=_read_text(instance_path, "instance"),
        label=printable(instance_path.stem) if is_own else f"{domain}-{instance}",
        is_own=is_own,
    )


def looks_like_file(argument: str) -> bool:
    """Whether an argument is meant as a file, not as a name of rddlrepository."""
    has_separator = "/" in argument or os.sep in argument
    return has_separator or argument.lower().endswith(".rddl") or os.path.isfile(argument)


def problem_names() -> list[str]:
    """The names of the shipped problems, then those of rddlrepository, in alphabetical order."""
    return [*shipped_names(), *sorted(rddl_repository().list_problems(), key=str.lower)]


def list_problems() -> list[str]:
    """One line for each problem that can be named: what to write, and its instances."""
    manager = rddl_repository()
    lines = shipped_names()
    for name in problem_names()[len(lines) :]:
        lines.append(f"{name} {'|'.join(manager.get_problem(name).list_instances())}")
    return lines


def _paths_of_one(name: str) -> tuple[Path, Path]:
    """The files of a shipped problem, or twice the one that is to hold a domain and an instance.

    Raises `InputError`, with near names, if it is neither.
    """
    if name in shipped_names():
        return shipped_files(name)
    if looks_like_file(name):
        return Path(name), Path(name)
    manager = rddl_repository()
    known = manager.list_problems()
    if name in known:
        available = " ".join(manager.get_problem(name).list_instances())
        raise InputError(f"which instance of '{name}'? It has: {available}")
    hint = _near(name, problem_names())
    raise InputError(f"there is no problem '{name}'{hint} ({_LIST})")


def _near(name: str, known: list[str]) -> str:
    """The known names that are like this one, as a question; empty if there is none."""
    by_lowercase = {problem.lower(): problem for problem in known}
    close = difflib.get_close_matches(name.lower(), by_lowercase, n=4, cutoff=0.5)
    names = " or ".join(by_lowercase[match] for match in close)
    return f"; did you mean {names}?" if close else ""


def _repository_paths(name: str, instance: str) -> tuple[Path, Path]:
    """Find a problem of rddlrepository. Raises `InputError` for an unknown name."""
    manager = rddl_repository()
    known = manager.list_problems()
    if name not in known:
        if name in shipped_names():
            raise InputError(f"'{name}' is a problem by itself: leave '{instance}' out")
        hint = _near(name, known)
        raise InputError(
            f"'{name}' is neither a file nor a problem of rddlrepository{hint} ({_LIST})"
        )
    info = manager.get_problem(name)
    available = info.list_instances()
    if instance not in available:
        raise InputError(
            f"'{instance}' is neither a file nor an instance of the rddlrepository problem "
            f"'{name}', which has: {' '.join(available)}"
        )
    return Path(info.get_domain()), Path(info.get_instance(instance))


def _read_text(path: Path, role: str) -> str:
    """Read a file with Unix line ends. Raises `InputError` if it cannot be read.

    A byte that is not UTF-8 becomes U+FFFD: legal in a comment, else refused by the lexer.
    """
    try:
        content = read_bounded(path, MOST_RDDL_BYTES)
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        cause = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot read the {role} file: {cause}") from error
    return decoded(content, errors="replace")
