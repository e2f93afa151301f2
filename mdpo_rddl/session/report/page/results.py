"""The figures of the page's tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.problem.evaluation import difference, mean_interval
from mdpo_rddl.session.report.page.charts import Returns
from mdpo_rddl.session.report.page.record import RunRecord
from mdpo_rddl.session.report.page.style import NOOP_COLOUR, POLICY_COLOUR, RANDOM_COLOUR


@dataclass(frozen=True)
class ResultRow:
    """Returns of one policy.

    Attributes:
      returns: with name and interval.
      difference: mean of what the first row's policy returned more; None in the first row, and
        where the problem is another.
      difference_interval: 95% interval of it; None for one episode.
      shared: of how many episodes that both have met; 0 where each had its own.
    """

    returns: Returns
    difference: float | None = None
    difference_interval: tuple[float, float] | None = None
    shared: int = 0

    @property
    def is_worse(self) -> bool:
        """Whether the first row's policy returned less, with 95% confidence."""
        return self.difference_interval is not None and self.difference_interval[1] < 0.0


def result_rows(run: RunRecord) -> list[ResultRow]:
    """The policy, and what it is compared with: those of its references that were played."""
    summary = run.summary
    policy = returns_of(_policy_name(summary), POLICY_COLOUR, summary)
    rows = [ResultRow(policy)]
    references = summary.get("references") or {}
    for key, name, colour in (
        ("noop", "no-op", NOOP_COLOUR),
        ("random", "random", RANDOM_COLOUR),
    ):
        if references.get(key) is not None:
            compare = independent if references[key].get("simulated") else compared
            rows.append(compare(policy, returns_of(name, colour, references[key])))
    return rows


def compared(first: Returns, other: Returns) -> ResultRow:
    """A row with the paired difference of two that met the same episodes, in the same order."""
    shared = min(len(first.returns), len(other.returns))
    gains = first.returns[:shared] - other.returns[:shared]
    gains = gains[np.isfinite(gains)]
    if not len(gains):
        return ResultRow(other)
    mean = float(np.mean(gains))
    return ResultRow(other, mean, mean_interval(gains), len(gains))


def independent(first: Returns, other: Returns) -> ResultRow:
    """A row with the difference of two that met episodes of their own."""
    one, two = (each.returns[np.isfinite(each.returns)] for each in (first, other))
    if not (len(one) and len(two)):
        return ResultRow(other)
    return ResultRow(other, float(np.mean(one) - np.mean(two)), difference(one, two))


def are_comparable(runs: Sequence[RunRecord]) -> bool:
    """Whether runs were evaluated on the same episodes: by their problem, horizon and seed."""
    keys = ("domain", "instance", "label", "horizon", "seed")
    return len({tuple(run.summary[key] for key in keys) for run in runs}) == 1


def returns_of(name: str, colour: str, figures: Mapping[str, Any]) -> Returns:
    """The returns that a summary holds, or a part of it."""
    returns = np.array(figures["returns"], dtype=float)  # None becomes NaN
    bounds = figures.get("ci95")
    if bounds is None or None in bounds:
        return Returns(name, colour, returns, None)
    return Returns(name, colour, returns, (bounds[0], bounds[1]))


def _policy_name(summary: Mapping[str, Any]) -> str:
    thinking = summary.get("thinking") or {}
    if summary.get("mode") == "replan":
        return "replanning"
    return "policy, thinking" if thinking.get("method") else "policy"
