"""What a problem was made of, as JSON can hold it, so that another process has the same one."""

from dataclasses import dataclass, replace
from pathlib import Path

from mdpo_rddl.problem.files import ProblemFiles
from mdpo_rddl.problem.load import Problem, parse_problem


@dataclass(frozen=True)
class ProblemSource:
    """The texts of a problem: nothing else is needed to load it again, neither file.

    Attributes:
      domain, instance: paths of the files, for error messages.
      domain_text, instance_text: what they held.
      label: the problem's.
      horizon: number of decisions in an episode.
    """

    domain: str
    instance: str
    domain_text: str
    instance_text: str
    label: str
    horizon: int

    @classmethod
    def of(cls, problem: Problem) -> "ProblemSource":
        """The source of a problem."""
        return cls(
            domain=str(problem.domain_path),
            instance=str(problem.instance_path),
            domain_text=problem.domain_text,
            instance_text=problem.instance_text,
            label=problem.label,
            horizon=problem.horizon,
        )

    def without_folders(self) -> "ProblemSource":
        """The same with the names of the files alone, for whoever gets it elsewhere."""
        domain, instance = Path(self.domain).name, Path(self.instance).name
        return replace(self, domain=domain, instance=instance)

    def load(self, tables: Path | None = None) -> Problem:
        """Loads the problem again.

        Args:
          tables: as `load_problem` takes them.

        Raises:
          InputError: if the texts are no problem.
        """
        files = ProblemFiles(
            domain_path=Path(self.domain),
            instance_path=Path(self.instance),
            domain_text=self.domain_text,
            instance_text=self.instance_text,
            label=self.label,
            is_own=False,  # the names were checked where they had to be
        )
        return parse_problem(files, self.horizon, tables)
