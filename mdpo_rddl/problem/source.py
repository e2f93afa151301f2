"""What a problem was made of, as JSON can hold it, so that another process has the same one."""

from dataclasses import dataclass, replace
from pathlib import Path

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.files import ProblemFiles
from mdpo_rddl.problem.functions import Functions, FunctionsGiven
from mdpo_rddl.problem.load import Problem, parse_problem


@dataclass(frozen=True)
class ProblemSource:
    """The texts of a problem: nothing else is needed to load it again, neither file.

    Attributes:
      domain, instance: paths of the files, for error messages.
      domain_text, instance_text: what they held.
      label: the problem's.
      horizon: number of decisions in an episode.
      functions: the file of the Python functions that the domain calls; its name is all that is
        kept of it, and whoever loads the problem gives it again; empty if they are from no file,
        None if there are none.
    """

    domain: str
    instance: str
    domain_text: str
    instance_text: str
    label: str
    horizon: int
    functions: str | None = None

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
            functions=_name_of(problem.functions),
        )

    def without_folders(self) -> "ProblemSource":
        """The same with the names of the files alone, for whoever gets it elsewhere."""
        domain, instance = Path(self.domain).name, Path(self.instance).name
        return replace(self, domain=domain, instance=instance)

    def load(self, tables: Path | None = None, functions: FunctionsGiven = None) -> Problem:
        """Loads the problem again.

        Args:
          tables, functions: as `load_problem` takes them.

        Raises:
          InputError: if the texts are no problem, or it needs functions that are not given.
        """
        if functions is None and self.functions is not None:
            of = f" of {self.functions}" if self.functions else ""
            raise InputError(
                f"{self.domain}: calls Python functions{of}, which are not kept: "
                "give them again, with --functions FILE.py or functions="
            )
        files = ProblemFiles(
            domain_path=Path(self.domain),
            instance_path=Path(self.instance),
            domain_text=self.domain_text,
            instance_text=self.instance_text,
            label=self.label,
            is_own=False,  # the names were checked where they had to be
        )
        return parse_problem(files, self.horizon, tables, functions)


def _name_of(functions: Functions | None) -> str | None:
    if functions is None:
        return None
    return "" if functions.path is None else functions.path.name
