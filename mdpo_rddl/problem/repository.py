"""The problems of rddlrepository, wherever that is installed."""

import contextlib
from functools import lru_cache

from rddlrepository import RDDLRepoManager
from rddlrepository.core.error import RDDLRepoManifestEmptyError


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
