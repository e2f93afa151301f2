"""The terms of a run, which are the same for every planner."""

from dataclasses import dataclass
from pathlib import Path

from mdpo_rddl.errors import printable
from mdpo_rddl.problem.files import looks_like_file


@dataclass(frozen=True)
class Rules:
    """What a planner gets, and what is asked of it.

    The defaults are those of the 2023 competition but for the memory, which is a machine's.

    Attributes:
      trials: number of trials on each instance.
      plan_seconds: preparation time on each instance; the process's start is not counted.
      trial_seconds: time of each trial; the two timers do not lend to each other.
      memory_gb: resident memory of a planner's process and all that it has started, in 1e9 bytes.
      lenient: whether a trial goes on after an action that breaks a precondition; such actions
        are counted either way.
      seed: of the run; each trial has an environment seed derived from it, the same for every
        planner.
    """

    trials: int = 50
    plan_seconds: float = 3600.0
    trial_seconds: float = 240.0
    memory_gb: float = 32.0
    lenient: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Instance:
    """One problem of a run, as `load_problem` takes it: two names or two files."""

    domain: str
    instance: str

    @property
    def domain_label(self) -> str:
        """The domain's name in tables and folders."""
        return printable(_label(self.domain))

    @property
    def label(self) -> str:
        """The instance's name in tables and folders."""
        return printable(_label(self.instance))


@dataclass(frozen=True)
class Entry:
    """One planner on one instance.

    Attributes:
      problem: the instance.
      planner: a name that `mdpo_rddl.ipc.registry` knows.
    """

    problem: Instance
    planner: str

    def folder(self, root: Path) -> Path:
        """Where things of this entry are kept under a root."""
        safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in printable(self.planner))
        return root / self.problem.domain_label / self.problem.label / safe


def _label(name: str) -> str:
    label = Path(name).stem if looks_like_file(name) else name
    # "...rddl" has the stem "..", which as a folder's name leads out of where it is
    return label if label.strip(".") else label.replace(".", "_")
