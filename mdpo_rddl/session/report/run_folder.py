"""The folder that a run leaves behind, complete or not there at all."""

import contextlib
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.config import PlannerConfig

SUMMARY = "summary.json"
POLICY = "policy.safetensors"
TRAJECTORIES = "trajectories.npz"
PAGE = "report.html"
RUN_FILES = {
    SUMMARY,
    POLICY,
    TRAJECTORIES,
    PAGE,
    "config.json",
    "history.csv",
    "noise.npy",
    "learning_curve.png",
    "noise.png",
    "decisions.csv",
    "candidates.csv",
}
"""All that a run writes; a folder that holds anything else is never replaced."""

logger = logging.getLogger(__name__)


class RunFolder:
    """A run folder under construction, for use in a `with` block.

    Files go to a hidden folder beside the target, which takes the target's name in one step
    when `commit` is called; without it, nothing is left, not even the folders made on the way
    there. An earlier run at the target is replaced by `commit` and not touched before; what
    appeared there meanwhile is not touched at all.

    Attributes:
      target: where the run folder will be.
      staging: where to write its files meanwhile.
    """

    def __init__(self, target: Path) -> None:
        """Claims a place for the run.

        Raises:
          InputError: if it cannot be written, or holds something that is not a run.
        """
        self.target = target
        self._made: list[Path] = []
        self._replaces = False
        with self.writing():
            self._check_target()
            self._made = [folder for folder in target.parents if not os.path.lexists(folder)]
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                staging = tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent)
            except OSError:
                self._remove_made()
                raise
            self.staging = Path(staging)
            self.staging.chmod(0o755)

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        shutil.rmtree(self.staging, ignore_errors=True)
        if not os.path.lexists(self.target):
            self._remove_made()

    def commit(self) -> None:
        """Puts the finished folder in its place.

        Raises:
          InputError: if that has become impossible meanwhile.
        """
        with self.writing():
            if not self._replaces:
                self._move_to_free_name()
                return
            replaced = Path(tempfile.mkdtemp(prefix=".replaced-", dir=self.target.parent))
            try:
                os.replace(self.target, replaced / self.target.name)
                os.replace(self.staging, self.target)
            except BaseException:  # an interrupt must not cost the earlier run either
                with contextlib.suppress(OSError):
                    os.replace(replaced / self.target.name, self.target)
                raise
            finally:
                shutil.rmtree(replaced, ignore_errors=True)

    def _move_to_free_name(self) -> None:
        wanted = self.target
        while True:
            try:
                os.rename(self.staging, self.target)  # fails where another run is by now
            except OSError:
                if not os.path.lexists(self.target):
                    raise
                self.target = free_name(wanted.parent, wanted.name)
            else:
                break
        if self.target != wanted:
            logger.warning("%s was taken meanwhile: the run is in %s", wanted, self.target)

    def _check_target(self) -> None:
        target = self.target
        if not target.is_dir():
            if os.path.lexists(target):
                raise InputError(f"{target}: cannot write the run there: it is a file")
            return
        if os.path.ismount(target) or Path.cwd().is_relative_to(target.resolve()):
            # it cannot be replaced, or not under the feet of who is in it
            raise InputError(f"{target}: cannot write the run there: name a folder inside it")
        entries = {entry.name for entry in target.iterdir()}
        self._replaces = bool(entries)
        if entries and SUMMARY not in entries:
            raise InputError(f"{target}: not overwritten: it is not empty and holds no run")
        foreign = sorted(entries - RUN_FILES)
        if foreign:
            raise InputError(f"{target}: not overwritten: it also holds {foreign[0]}")

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Turns what the file system refuses into an `InputError` that names the folder."""
        try:
            yield
        except OSError as error:
            cause = error.strerror or str(error)
            raise InputError(f"{self.target}: cannot write the run there: {cause}") from error

    def _remove_made(self) -> None:
        with contextlib.suppress(OSError):  # another run may be in there by now
            for folder in self._made:
                folder.rmdir()


def free_name(parent: Path, stem: str) -> Path:
    """The first of `stem`, `stem-2`, `stem-3`, ... under `parent` that is not taken."""
    candidate, number = parent / stem, 1
    while os.path.lexists(candidate):
        number += 1
        candidate = parent / f"{stem}-{number}"
    return candidate


def write_summary(folder: Path, config: PlannerConfig, summary: Mapping[str, Any]) -> None:
    """Writes the configuration that the policy belongs to, and the summary of the run.

    Args:
      folder: where.
      config: of the policy's planner; of the race if the policy is a table.
      summary: of the run; what is proven of a table is written beside the configuration too.
    """
    described = {
        "source": summary["config"],
        "sections": config.sections,
        "seed": summary["seed"],
        "episodes": summary["episodes"],
    }
    if "optimum" in summary:
        described["optimum"] = summary["optimum"]
    write_json(folder / "config.json", described)
    write_json(folder / SUMMARY, summary)


def write_json(path: Path, value: Any) -> None:
    """Writes readable JSON; NaN, which JSON does not have, is refused."""
    text = json.dumps(value, indent=2, allow_nan=False, default=_plain)
    path.write_text(text + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """What stands for the literals of a configuration that JSON does not have."""
    return sorted(value, key=repr) if isinstance(value, set) else repr(value)
