"""What is asked of a planning session, and who hears how it gets on."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.problem.load import Problem

if TYPE_CHECKING:  # which imports JAX
    from mdpo_rddl.planner.training.training import Progress

CHECKPOINT_SECONDS = 60.0


class Incumbent(NamedTuple):
    """The best policy of a race so far.

    Attributes:
      arm: that found it.
      mean: of its returns on the exact model.
    """

    arm: str
    mean: float


class Reporter(Protocol):
    """Who wants to know how a session gets on."""

    def stage(self, name: str) -> None:
        """A new stage begins."""

    def training(self, progress: "Progress") -> None:
        """An iteration is done."""

    def racing(self, fraction: float) -> None:
        """A race goes on, of whose time so large a part is over."""

    def incumbent(self, found: Incumbent) -> None:
        """A race has a better policy than before."""

    def episode(self, done: int, of: int) -> None:
        """An evaluation episode is done."""


class EvaluationTerms(Protocol):
    """What an evaluation must know of a request: the problem, the seed, how many episodes."""

    @property
    def problem(self) -> Problem:
        """What is played."""

    @property
    def seed(self) -> int:
        """Of the episodes, and of a policy that draws random numbers."""

    @property
    def episodes(self) -> int:
        """How many are played on the exact environment."""


class FindTerms(EvaluationTerms, Protocol):
    """What finding a policy must know of a request besides."""

    @property
    def config(self) -> PlannerConfig:
        """The planner's; its `[Optimize]` section holds the budget."""

    @property
    def traced_cache(self) -> Path | None:
        """Where traced programs are kept from one process to the next, if anywhere."""

    @property
    def start_from(self) -> AnyPolicy | None:
        """A policy that a race begins with, if any."""


@dataclass(frozen=True)
class Terms:
    """An evaluation's terms, and no more.

    Attributes:
      problem, seed, episodes: as in `EvaluationTerms`.
    """

    problem: Problem
    seed: int
    episodes: int


@dataclass(frozen=True)
class PlanRequest:
    """What to plan and how.

    Attributes:
      problem: the parsed problem.
      config: the planner's configuration; its `[Optimize]` section holds the budget.
      config_name: what to call it in the summary: the preset or the file.
      seed: of training and evaluation.
      episodes: evaluation episodes on the exact environment.
      out: where the run folder goes.
      traced_cache: where traced programs are kept from one process to the next, if anywhere.
      decision_seconds: that the policy may think at each decision of the evaluation; 0 plays it
        as it was prepared.
      command: the line that makes the run again, if a command was given.
      start_from: a policy that a race begins with, if any.
      movie: a file for the evaluation's first episode as a movie, if wanted.
      resume: whether to go on with the checkpoints of a run into that folder, if there are any.
      checkpoint_seconds: from one checkpoint to the next.
    """

    problem: Problem
    config: PlannerConfig
    config_name: str
    seed: int
    episodes: int
    out: Path
    traced_cache: Path | None = None
    decision_seconds: float = 0.0
    command: str | None = None
    start_from: AnyPolicy | None = None
    movie: Path | None = None
    resume: bool = False
    checkpoint_seconds: float = CHECKPOINT_SECONDS


@dataclass(frozen=True)
class LoadRequest:
    """Which saved policy to evaluate on which problem.

    Attributes:
      domain, instance, horizon: as `load_problem` takes them; the saved ones if None.
      folder: a run folder.
      seed: of the evaluation; the saved run's if None.
      episodes: evaluation episodes on the exact environment.
      out: where to write the new summary, if anywhere.
      decision_seconds, command, movie: as of a `PlanRequest`.
      functions: the file of the Python functions that the domain calls, if it calls any.
    """

    domain: str | None
    instance: str | None
    folder: Path
    episodes: int
    seed: int | None = None
    horizon: int | None = None
    out: Path | None = None
    decision_seconds: float = 0.0
    command: str | None = None
    movie: Path | None = None
    functions: Path | None = None
