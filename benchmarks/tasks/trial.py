"""One planner on one task: it prepares for a while, then it plays on the exact environment."""

import json
import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.records import Records
from benchmarks.tasks.published_episodes import ShorterReturns, published_seeds
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.ipc.mdpo import MDPO
from mdpo_rddl.ipc.planner import Improving, Planner
from mdpo_rddl.ipc.registry import check_planner, make_planner
from mdpo_rddl.ipc.thinking import ThinkingMDPO
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded
from mdpo_rddl.machine.memory import peak_mb
from mdpo_rddl.machine.versions import commit, versions
from mdpo_rddl.policy.lookahead.statistics import decision_figures
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

logger = logging.getLogger(__name__)

KEYS = ("problem", "instance", "planner", "seed")
FIGURES = (
    "horizon",
    "mean",
    "prepare_seconds",
    "play_seconds",
    "illegal_actions",
    "fallback_actions",
    "peak_mb",
    "commit",
    "arms",
    "returns",
)
COLUMNS = (*KEYS, "status", "cause", *FIGURES)
# of decisions with time to think, as `decision_figures` names most of them
_DECISIONS = ("decisions", "left_base", "p99_seconds", "max_seconds", "within_budget")
ALONE = "alone"
"""The column with the returns of the prepared policy alone, in the episodes with thinking."""
THINKING_COLUMNS = (*COLUMNS, "decision_seconds", "method", "note", *_DECISIONS, ALONE)
SHORTER = "shorter"
"""The column with the returns before the last step, in episodes of the published returns."""
OK = "ok"
# of the episodes, far from any training seed
_EVALUATION_SEED = 2024
# beside the preparation: the process's start, what is late, and the episodes
_PLAY_SECONDS = 900.0
# no task has more steps
_MOST_STEPS = 500
_DIGITS = 10
# where `mdpo-thinking` does not think an episode costs next to nothing; where it does, episodes of
# more steps are played fewer times, unless all are wanted
_PLAIN_EPISODES = 20
_USUAL_STEPS, _FEWEST_EPISODES = 40, 5


@dataclass(frozen=True)
class Task:
    """A problem instance of rddlrepository or of two files; or one that needs no instance named.

    That is a shipped problem, or a file that holds the instance, too.
    """

    problem: str
    instance: str = ""

    def load(self) -> Problem:
        """Parses it; raises what `load_problem` does."""
        return load_problem(self.problem, self.instance or None)


@dataclass(frozen=True)
class Conditions:
    """What all trials of a measurement have in common.

    Attributes:
      seconds: of preparation, compilation included.
      episodes: on the exact environment, the same for all planners; of `mdpo-thinking` at least 20
        where it plays its policy alone.
      memory_gb: of a trial's processes.
      decision_seconds: for `mdpo-thinking` at each decision; 0 where planners do not think.
      as_published: whether the episodes are those of the published returns, all of which
        `mdpo-thinking` plays where it thinks, too; else it plays no more than 40 decisions for each
        of them allow, but at least five.
    """

    seconds: float
    episodes: int
    memory_gb: float
    decision_seconds: float = 0.0
    as_published: bool = False

    @property
    def columns(self) -> tuple[str, ...]:
        """Of the rows."""
        columns = THINKING_COLUMNS if self.decision_seconds else COLUMNS
        return (*columns, SHORTER) if self.as_published else columns

    def seeds_of(self, episodes: int) -> int | list[int]:
        """The seeds of so many episodes, as `evaluate` takes them."""
        return published_seeds(episodes) if self.as_published else _EVALUATION_SEED

    @property
    def limits(self) -> Limits:
        """Of a trial's process."""
        thinking = self.episodes * _MOST_STEPS * self.decision_seconds
        return Limits(self.seconds + _PLAY_SECONDS + thinking, self.memory_gb)


@dataclass(frozen=True)
class TaskTrial:
    """One row's work."""

    task: Task
    planner: str
    seed: int
    conditions: Conditions
    make: Callable[[str], Planner] = make_planner


def run_tasks(
    out: Path,
    tasks: Sequence[Task],
    planners: Iterable[str],
    seeds: int,
    conditions: Conditions,
    make: Callable[[str], Planner] = make_planner,
) -> Records:
    """Runs the trials that `out/rows.csv` lacks, each in a process of its own.

    Args:
      out: results folder.
      tasks: in the order in which they are tried.
      planners: names that `mdpo-ipc` knows, or "module:Class".
      seeds: of the preparation, from 0.
      conditions: of all trials.
      make: a planner of each name, in the trial's process.

    Raises:
      InputError: for an unknown planner, or a folder with other results.
    """
    names = list(planners)
    if make is make_planner:
        for name in names:
            check_planner(name)
    kept = {"seconds": conditions.seconds, "episodes": conditions.episodes, **versions()}
    if conditions.decision_seconds:
        kept["decision_seconds"] = conditions.decision_seconds
    if conditions.as_published:
        kept["as_published"] = True
    columns = conditions.columns
    records = Records(out / "rows.csv", columns, KEYS, kept)
    trials = [
        TaskTrial(task, planner, seed, conditions, make)
        for task in tasks
        for planner in names
        for seed in range(seeds)
        if not records.has(task.problem, task.instance, planner, seed)
    ]
    for trial in trials:
        for _, outcome in run_guarded(run_trial, [trial], conditions.limits):
            row = _of_failure(outcome) if isinstance(outcome, ProcessFailure) else outcome
            key = (trial.task.problem, trial.task.instance, trial.planner, trial.seed)
            records.add(*key, *(row.get(name, "") for name in columns[len(KEYS) :]))
            logger.info("%s %s, %s, seed %d: %s %s", *key, row["status"], row.get("mean", ""))
    return records


def run_trial(trial: TaskTrial) -> dict[str, Any]:
    """Prepares and plays; an error becomes the status and its one-line cause."""
    row: dict[str, Any] = {"status": OK, "cause": "", "commit": commit()}
    try:
        evaluation = _play(trial, row)
    except Exception as error:  # whatever it is, it is the finding
        cause = f"{type(error).__name__}: {one_line_cause(error)}"
        return {**row, "status": "error", "cause": cause, "peak_mb": round(peak_mb())}
    if not np.all(np.isfinite(evaluation.returns)):
        row["status"] = "non-finite"
    return row | {
        "mean": float(f"{evaluation.mean:.{_DIGITS}g}"),
        "illegal_actions": evaluation.illegal_actions,
        "fallback_actions": evaluation.fallback_actions,
        "peak_mb": round(peak_mb()),
        "returns": _json(evaluation.returns.tolist()),
    }


def _json(returns: list[float]) -> str:
    """As a list of JSON."""
    digits = [float(f"{value:.{_DIGITS}g}") for value in returns]
    return json.dumps(digits)


def _play(trial: TaskTrial, row: dict[str, Any]) -> Evaluation:
    started = time.perf_counter()
    problem = trial.task.load()
    row["horizon"] = problem.horizon
    planner = trial.make(trial.planner)

    def left() -> float:
        return trial.conditions.seconds - (time.perf_counter() - started)

    if isinstance(planner, ThinkingMDPO):
        planner.decide_within(trial.conditions.decision_seconds)
    planner.prepare(problem, left(), trial.seed)
    if isinstance(planner, Improving):
        try:
            planner.improve(left())
        except Exception as error:  # the policy is there, and plays alone
            row["note"] = f"{type(error).__name__}: {one_line_cause(error)}"
    prepared = time.perf_counter()
    row["prepare_seconds"] = round(prepared - started, 2)
    if isinstance(planner, MDPO):
        row["arms"] = "; ".join(planner.found_by)
    random = np.random.default_rng(trial.seed)
    episodes = _episodes(planner, trial.conditions, problem.horizon)
    env = make_environment(problem)
    as_published = trial.conditions.as_published
    shorter = ShorterReturns(problem.horizon, env.discount) if as_published else None
    evaluation = evaluate(
        env,
        lambda step, state: planner.act(step, state, random),
        episodes,
        trial.conditions.seeds_of(episodes),
        recorder=shorter,
    )
    if shorter is not None:
        row[SHORTER] = _json(shorter.returns)
    row["play_seconds"] = round(time.perf_counter() - prepared, 2)
    if isinstance(planner, ThinkingMDPO):
        seconds = trial.conditions.decision_seconds
        row |= _decisions(planner, seconds, episodes, row.get("note"))
        if planner.thinker is not None:
            seeds = trial.conditions.seeds_of(episodes)
            row[ALONE] = _json(_alone(problem, planner, episodes, seeds).returns.tolist())
    return evaluation


def _alone(
    problem: Problem, planner: ThinkingMDPO, episodes: int, seeds: int | list[int]
) -> Evaluation:
    """The prepared policy without thinking, in the same episodes."""
    random = np.random.default_rng(0)  # it draws nothing
    return evaluate(
        make_environment(problem),
        lambda step, state: planner.act_alone(step, state, random),
        episodes,
        seeds,
    )


def _episodes(planner: Planner, conditions: Conditions, horizon: int) -> int:
    """How many of them are played."""
    wanted = conditions.episodes
    if not isinstance(planner, ThinkingMDPO):
        return wanted
    if planner.thinker is None:
        return max(wanted, _PLAIN_EPISODES)
    if conditions.as_published:
        return wanted
    return min(wanted, max(_FEWEST_EPISODES, _USUAL_STEPS * wanted // horizon))


def _decisions(
    planner: ThinkingMDPO, seconds: float, episodes: int, failure: str | None
) -> dict[str, Any]:
    """How decisions were made; a note instead of a method where the policy played alone."""
    thinker = planner.thinker
    if thinker is None:
        return {"decision_seconds": seconds, "note": failure or planner.note}
    figures = decision_figures(thinker.decisions, seconds, episodes)
    kept = {name: float(f"{figures[name]:.4g}") for name in _DECISIONS}
    return {"decision_seconds": seconds, "method": thinker.label, **kept}


def _of_failure(failure: ProcessFailure) -> dict[str, Any]:
    return {
        "status": failure.status,
        "cause": failure.cause,
        "peak_mb": round(failure.peak_mb),
        "commit": commit(),
    }
