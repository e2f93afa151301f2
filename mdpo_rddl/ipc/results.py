"""What is known of an entry, in a file that is rewritten in one step after each trial."""

import json
import reprlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from mdpo_rddl.errors import InputError, printable
from mdpo_rddl.ipc.numbers import is_count, is_finite
from mdpo_rddl.ipc.rules import Entry, Instance
from mdpo_rddl.ipc.trial import MOST_RETURN, OK
from mdpo_rddl.machine.files import read_json, write_atomically

RESULTS = "entries"
CRASH = "crash"
"""A process that ended by itself, sent what is no answer, or left no room on the disk."""
FINAL = ("timeout", "memory", CRASH)
"""How a process ends for good, see `mdpo_rddl.machine.guarded.ProcessFailure`."""


@dataclass(frozen=True)
class Preparation:
    """How a preparation phase went.

    Attributes:
      status: "ok", "error" (the planner raised one) or one of `FINAL`.
      cause: one line; empty if "ok".
      seconds: wall time.
      peak_mb: largest resident memory of the process.
    """

    status: str
    cause: str
    seconds: float
    peak_mb: float


@dataclass(frozen=True)
class Trial:
    """How one trial went.

    Attributes:
      trial: counted from 0.
      status: of `mdpo_rddl.ipc.trial.Played`, or one of `FINAL`.
      cause: one line; empty if "ok".
      total: the return; that of the steps played, if the trial ended early; None where it is not
        finite or ended with the process.
      steps, violations: of `Played`; 0 where they ended with the process.
      seconds: wall time.
    """

    trial: int
    status: str
    cause: str
    total: float | None
    steps: int
    violations: int
    seconds: float


@dataclass(frozen=True)
class EntryResult:
    """What is known of one planner on one instance.

    Attributes:
      entry: which.
      wanted: how many trials there are to be.
      preparation: None before its end.
      trials: in their order.
    """

    entry: Entry
    wanted: int
    preparation: Preparation | None = None
    trials: tuple[Trial, ...] = ()

    @property
    def is_complete(self) -> bool:
        """Whether all is played, or the planner failed in a way that leaves nothing to play."""
        if self.preparation is not None and self.preparation.status != OK:
            return True
        has_died = bool(self.trials) and self.trials[-1].status in FINAL
        return has_died or len(self.trials) == self.wanted

    def with_trial(self, trial: Trial) -> "EntryResult":
        """A copy with one more trial."""
        return replace(self, trials=(*self.trials, trial))

    def save(self, root: Path) -> None:
        """Writes the entry's file under a run's folder.

        Raises:
          InputError: naming the file, if it cannot be written.
        """
        text = json.dumps(asdict(self), indent=1, allow_nan=False)
        write_atomically(_path(root, self.entry), text.encode() + b"\n")


def load_result(root: Path, entry: Entry, wanted: int) -> EntryResult:
    """What a run's folder knows of an entry.

    Raises:
      InputError: naming the file, if it does not hold what `EntryResult.save` writes.
    """
    path = _path(root, entry)
    return _read(path, root) if path.exists() else EntryResult(entry, wanted)


def load_results(root: Path) -> list[EntryResult]:
    """All entries of which a run's folder has a file, by their paths.

    Raises:
      InputError: as `load_result`.
    """
    return [_read(path, root) for path in sorted((root / RESULTS).glob("*/*/*.json"))]


def _path(root: Path, entry: Entry) -> Path:
    folder = entry.folder(root / RESULTS)
    return folder.with_name(folder.name + ".json")


def _read(path: Path, root: Path) -> EntryResult:
    try:
        result = _parse(read_json(path, root))
        # what it says of itself is where it will be written to
        if _path(root, result.entry) != path:
            raise ValueError("another entry's")
        return result
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (AttributeError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: is not the result of an entry: {error!r}") from error


def _parse(values: Mapping[str, Any]) -> EntryResult:
    entry, preparation = values["entry"], values["preparation"]
    trials: Iterable[Mapping[str, Any]] = values["trials"]
    wanted = values["wanted"]
    if not is_count(wanted) or wanted == 0:
        raise TypeError(f"wanted is {reprlib.repr(wanted)}")
    return EntryResult(
        entry=Entry(Instance(**_typed(entry["problem"])), **_typed({"planner": entry["planner"]})),
        wanted=wanted,
        preparation=None if preparation is None else parse_preparation(preparation),
        trials=tuple(parse_trial(trial) for trial in trials),
    )


def parse_preparation(values: Mapping[str, Any]) -> Preparation:
    """What a process says of a preparation.

    Raises:
      TypeError, ValueError: if it is none.
    """
    return Preparation(**_typed(values))


def parse_trial(values: Mapping[str, Any], number: int | None = None) -> Trial:
    """What a process says of a trial.

    Args:
      values: of the trial.
      number: which one it is, if that is known.

    Raises:
      TypeError, ValueError: if it is none, or another one.
    """
    trial = Trial(**_typed(values))
    if number not in (None, trial.trial):
        raise ValueError(f"it is of trial {trial.trial}")
    if trial.status == OK and trial.total is None:
        raise ValueError("it has no return")
    return trial


_TEXTS = ("status", "cause", "domain", "instance", "planner")
# what a planner words, and files and terminals have to hold
_WORDED = ("status", "cause", "planner")
_COUNTS = ("trial", "steps", "violations")


def _typed(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values, if they are texts, counts and finite numbers where they should be.

    Raises:
      TypeError: naming one that is not.
    """
    for name, value in values.items():
        if not _is_right(name, value):
            raise TypeError(f"{name} is {reprlib.repr(value)}")
    return {name: printable(value) if name in _WORDED else value for name, value in values.items()}


def _is_right(name: str, value: Any) -> bool:
    if name in _TEXTS:
        return isinstance(value, str)
    if name in _COUNTS:
        return is_count(value)
    if name == "total":
        return value is None or (is_finite(value) and abs(value) <= MOST_RETURN)
    return is_finite(value)
