"""The problems that come with the package: each has one name, that of its instance file.

In a checkout their files are those of its folders `domains` and `instances`; a wheel has copies,
which `setup.py` makes.
"""

import string
from pathlib import Path

from mdpo_rddl.errors import InputError

_PACKAGE = Path(__file__).resolve().parents[1]
_SUFFIX = ".rddl"


def shipped_names() -> list[str]:
    """The names of the shipped problems, in alphabetical order."""
    return sorted(path.stem for path in (_root() / "instances").glob("*" + _SUFFIX))


def shipped_files(name: str) -> tuple[Path, Path]:
    """The domain file and the instance file of a shipped problem.

    An instance's name is that of its domain with a number behind it.

    Raises:
      InputError: if there is no such problem.
    """
    if name not in shipped_names():
        raise InputError(f"no shipped problem {name!r}, only {', '.join(shipped_names())}")
    domain = name.rstrip(string.digits)
    root = _root()
    return root / "domains" / (domain + _SUFFIX), root / "instances" / (name + _SUFFIX)


def _root() -> Path:
    """The folder in which `domains` and `instances` lie."""
    packaged = _PACKAGE / "shipped"
    return packaged if packaged.is_dir() else _PACKAGE.parent
