"""Where a problem came from, as JSON can hold it, so that another process has the same one."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.load import Problem, load_problem


@dataclass(frozen=True)
class ProblemSource:
    """The files of a problem and what tells it from others.

    Attributes:
      domain, instance: absolute paths.
      label: the problem's.
      horizon: number of decisions in an episode.
      digest: of both files' text.
    """

    domain: str
    instance: str
    label: str
    horizon: int
    digest: str

    @classmethod
    def of(cls, problem: Problem) -> "ProblemSource":
        """The source of a problem."""
        return cls(
            domain=str(problem.domain_path.absolute()),
            instance=str(problem.instance_path.absolute()),
            label=problem.label,
            horizon=problem.horizon,
            digest=problem.digest,
        )

    def load(self, tables: Path | None = None) -> Problem:
        """Loads the problem again.

        Args:
          tables: as `load_problem` takes them.

        Raises:
          InputError: if the files are not what they were.
        """
        # the names were checked where they had to be
        problem = load_problem(
            self.domain, self.instance, self.horizon, tables, names_must_agree=False
        )
        if problem.digest != self.digest:
            raise InputError(f"{self.instance}: the problem's files have changed meanwhile")
        return dataclasses.replace(problem, label=self.label)
