"""Which instances a run is about, from one line of text."""

import re
from collections.abc import Iterable
from pathlib import Path

from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.rules import Instance
from mdpo_rddl.problem.competition import REPOSITORY_NAMES
from mdpo_rddl.problem.files import looks_like_file
from mdpo_rddl.problem.repository import rddl_repository

COMPETITION = ",".join(f"{name}:1-5" for name in REPOSITORY_NAMES.values())
"""The forty instances of the 2023 competition."""

_RANGE = re.compile(r"(\d+)-(\d+)")


def parse_problems(text: str) -> list[Instance]:
    """Reads "HVAC_ippc2023:1-5,RaceCar_ippc2023:1,3,domain.rddl:instance.rddl".

    Before a colon stands a problem of rddlrepository or a domain file; after it, instances or
    ranges of them; a piece without a colon is one more instance of the same domain.

    Raises:
      InputError: naming what is no problem, no instance of it, or named twice.
    """
    instances: list[Instance] = []
    domain = None
    for piece in filter(None, (piece.strip() for piece in text.split(","))):
        before, colon, after = piece.rpartition(":")
        if colon:
            domain = before
        if not domain:
            raise InputError(f"--problems: {piece!r} names no domain, write DOMAIN:INSTANCE")
        instances += [_checked(Instance(domain, name)) for name in _expanded(domain, after)]
    if not instances:
        raise InputError("--problems: there is no problem in it")
    _check_labels(instances)
    return instances


def _expanded(domain: str, names: str) -> Iterable[str]:
    found = _RANGE.fullmatch(names)
    if looks_like_file(domain) or found is None:
        return [names]
    first, last = map(int, found.groups())
    if first > last:
        raise InputError(f"--problems: the range {names} is empty")
    return map(str, range(first, last + 1))


def _checked(problem: Instance) -> Instance:
    files = [Path(name) for name in (problem.domain, problem.instance) if looks_like_file(name)]
    if files:
        for path in (Path(problem.domain), Path(problem.instance)):
            if not path.is_file():
                raise InputError(f"--problems: {path}: no such file")
        return problem
    manager = rddl_repository()
    if problem.domain not in manager.list_problems():
        raise InputError(f"--problems: rddlrepository has no problem {problem.domain!r}")
    known = manager.get_problem(problem.domain).list_instances()
    if problem.instance not in known:
        raise InputError(
            f"--problems: {problem.domain} has no instance {problem.instance!r}, "
            f"known are {' '.join(known)}"
        )
    return problem


def _check_labels(instances: Iterable[Instance]) -> None:
    seen: set[tuple[str, str]] = set()
    for problem in instances:
        label = (problem.domain_label, problem.label)
        if label in seen:
            raise InputError(f"--problems: {':'.join(label)} is there twice")
        seen.add(label)
