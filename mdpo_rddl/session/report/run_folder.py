"""The folder that a run leaves behind, complete or not there at all."""

import contextlib
import json
import logging
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import is_temporary, read_json, sync_folder, write_atomically
from mdpo_rddl.machine.locks import FolderLock
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.session.unfinished import CHECKPOINTS, UNFINISHED

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

_LOCK, _STAGING, _REPLACED = "lock", "staging", "replaced"

logger = logging.getLogger(__name__)


class RunFolder:
    """A run folder under construction, for use in a `with` block.

    Files go to a folder beside the target, `NAME.unfinished`, which one process at a time may
    use. What was staged there takes the target's name in one step when `commit` is called. An
    earlier run at the target is replaced by `commit` and not touched before; what appeared there
    meanwhile is not touched at all.

    With the block `NAME.unfinished` goes too, and the folders made on the way there, unless it
    holds checkpoints that `commit` was not told to drop: then a later run can resume them.

    Attributes:
      target: where the run folder will be.
      unfinished: where checkpoints are kept until the run is finished.
      staging: where to write the run's files meanwhile.
    """

    def __init__(self, target: Path, resume: bool = False) -> None:
        """Claims a place for the run.

        Args:
          target: where the run folder will be.
          resume: whether checkpoints that are there are to be used; else they are in the way.

        Raises:
          InputError: if it cannot be written, holds something that is not a run, is in use by
            another process, or does not go with `resume`.
        """
        self.target = target
        self.unfinished = target.parent / f"{target.name}{UNFINISHED}"
        self.staging = self.unfinished / _STAGING
        self._made: list[Path] = []
        self._replaces = self._is_done = False
        with self.writing():
            self._check_target()
            self._made = [folder for folder in target.parents if not os.path.lexists(folder)]
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                self.unfinished.mkdir(exist_ok=True)
                self._lock = FolderLock(self.unfinished / _LOCK, str(target))
            except BaseException:
                self._remove_folder()
                raise
            try:
                self._check_checkpoints(resume)
                self._clear_staging()
                self.staging.mkdir(mode=0o755)
            except BaseException:
                self._leave()
                raise

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # an earlier run that could not be put back stays in its place, for the next one to do so
        _remove(self.staging)
        self._leave()

    @property
    def checkpoints(self) -> list[str]:
        """Names of the checkpoints that `unfinished` holds."""
        return sorted(_names(self.unfinished) & CHECKPOINTS)

    def commit(self, is_finished: bool = True) -> None:
        """Puts the staged folder in its place, unless it is there already.

        Args:
          is_finished: whether the run is; else its checkpoints stay.

        Raises:
          InputError: if that has become impossible meanwhile.
        """
        with self.writing():
            if not self.staging.is_dir():
                return
            _sync_files(self.staging)
            if self._replaces:
                self._replace()
            else:
                self._move_to_free_name()
            self._is_done = is_finished
            sync_folder(self.target.parent)

    def _replace(self) -> None:
        replaced = self.unfinished / _REPLACED
        _remove(replaced)
        try:
            os.replace(self.target, replaced)
            if _names(replaced) <= RUN_FILES:
                os.replace(self.staging, self.target)
            else:  # somebody has put more there meanwhile
                os.replace(replaced, self.target)
                self._move_to_free_name()
        except BaseException:  # an interrupt must not cost the earlier run either
            with contextlib.suppress(OSError):
                os.replace(replaced, self.target)
            raise
        _remove(replaced)

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
        for path in (target, self.unfinished):
            if path.is_symlink():  # which would be replaced, not what it leads to
                raise InputError(f"{path}: cannot write the run there: it is a link")
        if not target.is_dir():
            if os.path.lexists(target):
                raise InputError(f"{target}: cannot write the run there: it is a file")
            return
        if os.path.ismount(target) or Path.cwd().is_relative_to(target.resolve()):
            # it cannot be replaced, or not under the feet of who is in it
            raise InputError(f"{target}: cannot write the run there: name a folder inside it")
        entries = _names(target)
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

    def _check_checkpoints(self, resume: bool) -> None:
        # killed between two renames: the earlier run's folder is not lost
        replaced = self.unfinished / _REPLACED
        if _is_folder(replaced) and not os.path.lexists(self.target):
            os.replace(replaced, self.target)
            self._check_target()
        for path in self.unfinished.iterdir():
            if is_temporary(path.name):  # killed while it was written
                path.unlink()
        foreign = sorted(_names(self.unfinished) - CHECKPOINTS - {_LOCK, _STAGING, _REPLACED})
        if foreign:
            raise InputError(f"{self.unfinished}: is in the way: it also holds {foreign[0]}")
        kept = self.checkpoints
        if kept and not resume:
            raise InputError(
                f"{self.unfinished}: holds an unfinished run, which --resume goes on with; "
                "delete it to begin anew"
            )
        if resume and not kept and self._replaces and not _was_stopped(self.target):
            raise InputError(f"{self.target}: the run there is finished, nothing is left to resume")

    def _clear_staging(self) -> None:
        for name in (_STAGING, _REPLACED):
            _remove(self.unfinished / name)

    def _leave(self) -> None:
        with contextlib.suppress(OSError):
            if self._is_done:
                for name in self.checkpoints:
                    (self.unfinished / name).unlink()
        self._lock.release()
        self._remove_folder()

    def _remove_folder(self) -> None:
        """Removes what was made on the way to the target, as far as nothing is in it."""
        with contextlib.suppress(OSError):  # it holds checkpoints, or another run has it now
            self.unfinished.rmdir()
        with contextlib.suppress(OSError):  # another run may be in there by now
            for folder in self._made:
                folder.rmdir()


def _names(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()}


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _remove(path: Path) -> None:
    """Removes what is there, if anything; of a link only itself."""
    with contextlib.suppress(OSError):
        if _is_folder(path):
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


def _was_stopped(folder: Path) -> bool:
    """Whether the run there says that it was."""
    with contextlib.suppress(InputError, OSError, ValueError, AttributeError):
        return bool(read_json(folder / SUMMARY, folder).get("status") == "interrupted")
    return False


def _sync_files(folder: Path) -> None:
    """Puts the contents of a folder's files on the disk."""
    for path in folder.iterdir():
        with path.open("rb") as file:
            os.fsync(file.fileno())
    sync_folder(folder)


def free_name(parent: Path, stem: str) -> Path:
    """The first of `stem`, `stem-2`, `stem-3`, ... under `parent` that no run has taken."""
    candidate, number = parent / stem, 1
    while any(os.path.lexists(f"{candidate}{suffix}") for suffix in ("", UNFINISHED)):
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
    write_atomically(path, text + "\n")


def _plain(value: Any) -> Any:
    """What stands for the literals of a configuration that JSON does not have."""
    return sorted(value, key=repr) if isinstance(value, set) else repr(value)
