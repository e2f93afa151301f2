"""The problems of rddlrepository, wherever that is installed."""

import contextlib
from functools import lru_cache

from rddlrepository import RDDLRepoManager
from rddlrepository.core.error import RDDLRepoManifestEmptyError

from mdpo_rddl.errors import InputError


class _Manager(RDDLRepoManager):
    """Takes a folder in which no list of the problems can be written, as a user's own may not be.

    The list is written last, when all that it holds is known.
    """

    def _build_repo(self) -> None:
        with contextlib.suppress(OSError):
            super()._build_repo()


@lru_cache(maxsize=1)
def rddl_repository() -> RDDLRepoManager:
    """The manager of the problems, made once in a process."""
    try:
        return _Manager()
    except RDDLRepoManifestEmptyError:  # another process is about to write the list
        return _Manager(rebuild=True)


def named_instance(name: str) -> tuple[str, str]:
    """A problem and its instance.

    Args:
      name: "Problem", for the first instance that rddlrepository lists, or "Problem:instance".

    Raises:
      InputError: for an unknown problem or instance.
    """
    problem, colon, instance = name.partition(":")
    if problem not in rddl_repository().list_problems():
        raise InputError(f"rddlrepository has no problem {problem!r}")
    instances = [str(each) for each in rddl_repository().get_problem(problem).list_instances()]
    if colon and instance not in instances:
        raise InputError(f"rddlrepository has no instance {instance!r} of {problem}")
    return problem, instance if colon else instances[0]
