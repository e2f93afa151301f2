"""The scores of a run: raw returns with intervals, and the competition's normalised ones.

An instance is worth 0 at the better one of the no-op and the random player, and 1 at the best
planner of the run, linearly between them and clipped to [0, 1]; a failure in any trial is worth
0 (IPPC 2023). A domain is worth the mean over its instances, but for those on which the no-op and
the random player fail, a run the mean over its domains.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.ipc.names import FLOOR
from mdpo_rddl.ipc.results import EntryResult
from mdpo_rddl.ipc.rules import Instance
from mdpo_rddl.ipc.trial import OK
from mdpo_rddl.problem.evaluation import mean_interval

MODES = ("strict", "lenient")
"""Whether a broken precondition fails the trial, as an action that cannot be taken always does."""


@dataclass(frozen=True)
class EntryScore:
    """How one planner did on one instance.

    Attributes:
      mean: mean return over the trials that count; None where the planner failed.
      interval: Student's 95% interval of the mean; None as `mean`, or with one trial.
      normalised: the competition's score in [0, 1]; None if no player of `FLOOR` was ranked.
      failure: why the instance is worth 0, one line; empty if it did not fail.
      failed_trials: how many trials failed; trials never played are among them.
      violations: actions that broke a precondition, over all trials.
      is_best: whether no other planner has a higher mean.
      is_level: whether the best mean lies within this planner's interval, or it is the best.
    """

    mean: float | None
    interval: tuple[float, float] | None
    normalised: float | None
    failure: str
    failed_trials: int
    violations: int
    is_best: bool
    is_level: bool


@dataclass(frozen=True)
class Scores:
    """The scores of a run in one mode.

    Attributes:
      planners: in the order of the run.
      cells: per instance and planner; what has not ended yet is missing.
      domains: per domain label and planner, the mean normalised score over its instances;
        missing where an instance has none yet. Instances on which the no-op and random actions
        have failed are left out.
      overall: per planner, the mean over the domains; missing as in `domains`.
    """

    planners: tuple[str, ...]
    cells: Mapping[Instance, Mapping[str, EntryScore]]
    domains: Mapping[str, Mapping[str, float]]
    overall: Mapping[str, float]

    def better_of(self, planners: Sequence[str]) -> float | None:
        """The overall score of whoever of some planners is better, instance by instance.

        Returns:
          None if one of them has not ended everywhere, or there is no floor.
        """
        by_domain: dict[str, list[float]] = {}
        for problem, row in self.cells.items():
            if _floor_failed(row, self.planners):
                continue
            values = [row[name].normalised for name in planners if name in row]
            known = [value for value in values if value is not None]
            if len(known) < len(planners):
                return None
            by_domain.setdefault(problem.domain_label, []).append(max(known))
        if not by_domain:
            return None
        return float(np.mean([np.mean(values) for values in by_domain.values()]))

    def count(self, planner: str, best_only: bool = False) -> int:
        """On how many instances a planner is best, or level with the best."""
        found = [row[planner] for row in self.cells.values() if planner in row]
        return sum(cell.is_best if best_only else cell.is_level for cell in found)


def score(results: Iterable[EntryResult], mode: str, planners: Sequence[str]) -> Scores:
    """Scores all entries that have ended.

    Args:
      results: of one run.
      mode: out of `MODES`.
      planners: in the order wanted.
    """
    by_problem: dict[Instance, dict[str, EntryResult]] = {}
    for result in results:
        row = by_problem.setdefault(result.entry.problem, {})
        if result.is_complete:
            row[result.entry.planner] = result
    cells = {problem: _row(row, mode) for problem, row in by_problem.items()}
    rows: dict[str, list[Mapping[str, EntryScore]]] = {}
    for problem, scored in cells.items():
        of_domain = rows.setdefault(problem.domain_label, [])
        if not _floor_failed(scored, planners):
            of_domain.append(scored)
    domains = {label: _means(own, planners) for label, own in rows.items()}
    ranked = {label: domains[label] for label, own in rows.items() if own}
    return Scores(tuple(planners), cells, domains, _overall(ranked, planners))


def _floor_failed(row: Mapping[str, EntryScore], planners: Iterable[str]) -> bool:
    """Whether those that a score of 0 stands for have ended on an instance, and all failed."""
    floor = [name for name in FLOOR if name in planners]
    ended = [row[name] for name in floor if name in row]
    return bool(floor) and len(ended) == len(floor) and all(one.mean is None for one in ended)


def _row(results: Mapping[str, EntryResult], mode: str) -> dict[str, EntryScore]:
    failures = {name: _failure(result, mode) for name, result in results.items()}
    played = {
        name: np.array([trial.total for trial in result.trials], float)
        for name, result in results.items()
        if not failures[name]
    }
    means = {name: float(returns.mean()) for name, returns in played.items()}
    best = max(means.values(), default=-np.inf)
    floor = max((means[name] for name in FLOOR if name in means), default=None)
    row = {}
    for name, result in results.items():
        mean, interval = means.get(name), _interval(played.get(name))
        is_best = mean is not None and mean >= best
        ok = sum(_counts(trial.status, trial.violations, mode) for trial in result.trials)
        row[name] = EntryScore(
            mean=mean,
            interval=interval,
            normalised=normalise(mean, floor, best),
            failure=failures[name],
            failed_trials=result.wanted - ok,
            violations=sum(trial.violations for trial in result.trials),
            is_best=is_best,
            is_level=is_best or (interval is not None and interval[0] <= best <= interval[1]),
        )
    return row


def normalise(mean: float | None, floor: float | None, best: float) -> float | None:
    """The competition's score of a mean return; 0 for a failure, None without a floor.

    Where no planner is above the floor, all are worth 0.
    """
    if floor is None:
        return None
    if mean is None or best <= floor:
        return 0.0
    return float(np.clip((mean - floor) / (best - floor), 0.0, 1.0))


def _counts(status: str, violations: int, mode: str) -> bool:
    return status == OK and (mode == "lenient" or violations == 0)


def _failure(result: EntryResult, mode: str) -> str:
    preparation = result.preparation
    if preparation is not None and preparation.status != OK:
        return f"preparation: {preparation.status}: {preparation.cause}"
    for trial in result.trials:
        if not _counts(trial.status, trial.violations, mode):
            if trial.status == OK:
                return f"trial {trial.trial}: {trial.violations} illegal actions"
            return f"trial {trial.trial}: {trial.status}: {trial.cause}"
    return ""


def _interval(returns: np.ndarray | None) -> tuple[float, float] | None:
    return None if returns is None else mean_interval(returns)


def _means(rows: Sequence[Mapping[str, EntryScore]], planners: Iterable[str]) -> dict[str, float]:
    means = {}
    for name in planners:
        values = [row[name].normalised for row in rows if name in row]
        known = [value for value in values if value is not None]
        if rows and len(known) == len(rows):
            means[name] = float(np.mean(known))
    return means


def _overall(
    domains: Mapping[str, Mapping[str, float]], planners: Iterable[str]
) -> dict[str, float]:
    overall = {}
    for name in planners:
        values = [scores[name] for scores in domains.values() if name in scores]
        if values and len(values) == len(domains):
            overall[name] = float(np.mean(values))
    return overall
