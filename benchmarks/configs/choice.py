"""Which configuration suits a domain best, over all instances that were tried."""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from benchmarks.configs.candidates import candidates

NOOP, BASELINE = "do nothing", "JaxPlan 3.1"
REFERENCES = (NOOP, BASELINE)
_LEVEL = 0.02


def choose(rows: Iterable[Mapping[str, str]], domain: str, plan: str) -> str:
    """The candidate that the rows speak for.

    On each instance a return has the competition's score, (return - no-op's) / (best -
    no-op's) over all that was tried there, at least 0. Fit are the candidates that were
    tried on most instances and whose mean score is not below JaxPlan's by more than its standard
    error. Of these the largest mean wins, or one level with it (within 0.02) that needs fewer
    rollouts an iteration, so that larger instances fit into memory; "jaxplan" if none is fit.

    Args:
      rows: with `COLUMNS`.
      domain, plan: which of them.
    """
    scores = mean_scores(rows, domain, plan)
    reference = scores.pop(BASELINE, Score(-math.inf, 0.0, 0))
    scores.pop(NOOP, None)
    most = max((score.instances for score in scores.values()), default=0)
    fit = {
        name: score.mean
        for name, score in scores.items()
        if score.instances == most
        and score.mean >= reference.mean - math.hypot(score.error, reference.error)
    }
    best = max(fit.values(), default=0.0)
    level = [name for name in fit if fit[name] >= best - _LEVEL]
    configs = candidates(domain, plan)
    batch = {name: configs[name].batch_size for name in level}
    return min(level, key=lambda name: (batch[name], -fit[name]), default="jaxplan")


class Score(NamedTuple):
    """A mean over instances of the competition's score.

    Attributes:
      mean, error: with its standard error.
      instances: how many.
    """

    mean: float
    error: float
    instances: int


def mean_scores(rows: Iterable[Mapping[str, str]], domain: str, plan: str) -> dict[str, Score]:
    """Per candidate and reference, over the instances on which it has a return.

    Where the no-op was not tried, the worst return stands for it. What failed scores 0.

    Args:
      rows: with `COLUMNS`.
      domain, plan: which of them.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    own = [row for row in rows if row["domain"] == domain and row["plan"] == plan]
    for instance in sorted({row["instance"] for row in own}):
        tried = {row["candidate"]: row for row in own if row["instance"] == instance}
        means = {name: _number(row["return"]) for name, row in tried.items()}
        known = [mean for mean in means.values() if math.isfinite(mean)]
        floor = means.get(NOOP, min(known, default=0.0))
        span = max(known, default=floor) - floor
        for name, mean in means.items():
            score, error = 0.0, 0.0
            if span > 0 and math.isfinite(mean):
                score = max(0.0, (mean - floor) / span)
                error = _number(tried[name]["error"]) / span
            found.setdefault(name, []).append((score, error))
    return {
        name: Score(
            float(np.mean([score for score, _ in scores])),
            math.hypot(*(error for _, error in scores)) / len(scores),
            len(scores),
        )
        for name, scores in found.items()
    }


def _number(text: str) -> float:
    return float(text) if text else math.nan
