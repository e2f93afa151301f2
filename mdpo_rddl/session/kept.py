"""The newest of something that a run keeps until it is finished, and the one before."""

import json
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.container import Metadata, Tensors, read_container, write_container
from mdpo_rddl.session.requests import FindTerms

_MOST_WRITTEN = 2**53

logger = logging.getLogger(__name__)

Kept = TypeVar("Kept")


class KeptPair(Generic[Kept]):
    """Two files that are written in turn, so that one is whole whenever the run is killed.

    Attributes:
      newest: what the newer one held at the beginning; None if there was none.
    """

    def __init__(
        self,
        paths: tuple[Path, Path],
        file_format: str,
        terms: FindTerms,
        parse: Callable[[Metadata, Tensors], Kept],
    ) -> None:
        """Reads what an earlier process has kept.

        Args:
          paths: of the files, in a folder that is there.
          file_format: what a file says that it is.
          terms: what is planned; files of anything else are refused.
          parse: makes something of a file's text and tensors, or raises LookupError, TypeError or
            ValueError.

        Raises:
          InputError: if there are files, but none that can be used.
        """
        self._paths, self._format, self._parse = paths, file_format, parse
        self._terms = identity(terms)
        self._number = 0
        self.newest: Kept | None = None
        refused: list[InputError] = []
        for path in paths:
            try:
                found = self._read(path)
            except InputError as error:
                refused.append(error)
                continue
            if found is not None and found[0] >= self._number:
                self._number, self.newest = found[0] + 1, found[1]
        if refused and self.newest is None:
            raise refused[0]
        for each in refused:
            logger.warning("%s: the other one is used", each)

    def write(self, tensors: Tensors, text: Metadata) -> None:
        """Writes over the older one.

        A disk that is full or gone costs this file, not the run.
        """
        text = {**text, "format": self._format, "terms": json.dumps(dict(self._terms))}
        text["number"] = str(self._number)
        try:
            write_container(self._paths[self._number % 2], tensors, text)
        except InputError as error:
            logger.warning("no checkpoint: %s", error)
            return
        self._number += 1

    def _read(self, path: Path) -> tuple[int, Kept] | None:
        """What a file holds, with its number; None if there is no file."""
        if not path.exists():
            return None
        text, tensors = read_container(path, (self._format,), path.parent)
        try:
            terms, number = json.loads(text["terms"]), int(text["number"])
            if not 0 <= number < _MOST_WRITTEN:
                raise ValueError(f"number {number}")
            differing = [name for name in self._terms if terms[name] != self._terms[name]]
            if differing:  # what it holds belongs to those terms
                raise InputError(f"{path}: cannot be resumed: it is of another {differing[0]}")
            return number, self._parse(text, tensors)
        except (
            ArithmeticError,
            AttributeError,
            LookupError,
            RecursionError,
            TypeError,
            ValueError,
        ) as error:
            raise InputError(f"{path}: damaged checkpoint: {error!r:.200}") from error


def identity(terms: FindTerms) -> Mapping[str, Any]:
    """What must be the same for a run to go on."""
    problem = terms.problem
    return {
        "problem": problem.digest,
        "horizon": problem.horizon,
        "seed": terms.seed,
        "configuration": terms.config.to_text(),
    }
