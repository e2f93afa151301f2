"""The cells of a folder, and each method compared with no noise, seed by seed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.noise_value.cells import OK, read
from benchmarks.noise_value.methods import METHODS, NONE, TWICE
from benchmarks.noise_value.rule import Case
from benchmarks.noise_value.statistics import LEVEL, holm, normalised, t_test_p

BESIDE = {f"{name} beside": name for name in ("adaptive", "paper")}
"""Other companions for an update without noise: of each seed the better one by JaxPlan's test.

They begin with the same initial parameters as that update, those of `METHODS` with others. So they
have one start less, and are not to be compared with those.
"""

COMPARED = (*METHODS, *BESIDE)
"""All methods of the report."""

Scores = Mapping[str, np.ndarray]


class Task(NamedTuple):
    """What all methods were measured on."""

    problem: str
    instance: str
    plan: str
    configuration: str

    def __str__(self) -> str:
        return f"{self.problem} {self.instance}, {self.plan}, {self.configuration}"


class Lead(NamedTuple):
    """A method against another one on one task.

    Attributes:
      mean: of the returns' difference over the seeds.
      p: of the paired t-test.
      adjusted: the same after Holm over all tasks.
    """

    mean: float
    p: float
    adjusted: float

    @property
    def is_significant(self) -> bool:
        """After Holm."""
        return self.adjusted < LEVEL


def load_results(out: Path) -> tuple[dict[Task, dict[str, Any]], list[str]]:
    """The finished cells of a folder per task, and the names of those that failed.

    Raises:
      InputError: if a file is not a cell's.
    """
    results, failed = {}, []
    for path in sorted((out / "cells").glob("*.json")):
        kept = read(path)
        conditions = kept["conditions"]
        task = Task(*(conditions[name] for name in Task._fields))
        if kept["status"] == OK:
            results[task] = kept
        else:
            failed.append(f"{task} ({kept['status']})")
    return results, failed


def returns_of(kept: Mapping[str, Any], method: str) -> np.ndarray:
    """The exact returns of a cell's seeds [S] with a method."""
    if method in BESIDE:
        ours, plain = kept["methods"][BESIDE[method]], kept["methods"][NONE]
        ahead = np.asarray(ours["tested"], float) > np.asarray(plain["tested"], float)
        return np.where(ahead, ours["returns"], plain["returns"])
    return np.asarray(kept["methods"][method]["returns"], float)


def scores_of(kept: Mapping[str, Any]) -> Scores:
    """Normalised scores of a cell per method [S]."""
    returns = {name: returns_of(kept, name) for name in COMPARED}
    return normalised(returns, float(kept["noop"]))


def compare(
    results: Mapping[Task, Mapping[str, Any]], method: str, other: str = NONE
) -> dict[Task, Lead]:
    """A method against another one on every task."""
    pairs = [(returns_of(kept, method), returns_of(kept, other)) for kept in results.values()]
    values = [t_test_p(ours, theirs) for ours, theirs in pairs]
    return {
        task: Lead(float(np.mean(ours) - np.mean(theirs)), p, float(adjusted))
        for task, (ours, theirs), p, adjusted in zip(
            results, pairs, values, holm(values), strict=True
        )
    }


def cases(
    results: Mapping[Task, Mapping[str, Any]], scores: Mapping[Task, Scores], method: str
) -> list[Case]:
    """Whether a method's companion with noise is worth more than one without."""
    return [
        Case(
            family=task.problem.split("_")[0],
            signs=kept["signs"],
            lead=float(np.mean(scores[task][method]) - np.mean(scores[task][TWICE])),
        )
        for task, kept in results.items()
    ]
