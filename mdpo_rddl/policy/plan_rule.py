"""How relaxed plans are made into decisions, and what that has returned, as text too."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mdpo_rddl.problem.delete_relaxation.distances import Prices

_KEY = "plan_rule"
# episodes or samples that a file may tell of
_MOST = 2**20


@dataclass(frozen=True)
class PlanRule:
    """What decides beside the relaxation itself.

    Attributes:
      patience: what is promised if nothing is played, as a share: below 1 something is done.
      others: the weight of all goals beside that of the most promising one.
      prices: what ways to goals cost.
      samples: next states that stand for all that may follow a decision.
      searches: whether the way is searched for where no step comes nearer to a goal.

    Raises:
      ValueError: if a share or weight is not between 0 and 1, or there is no sample.
    """

    patience: float = 0.8
    others: float = 0.02
    prices: Prices = field(default_factory=Prices)
    samples: int = 8
    searches: bool = False

    def __post_init__(self) -> None:
        for name, value in (("patience", self.patience), ("others", self.others)):
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name}: {value!r} is not between 0 and 1")
        if self.samples < 1:
            raise ValueError(f"samples: must be at least 1, got {self.samples!r}")


@dataclass(frozen=True)
class Simulated:
    """What simulated episodes have returned.

    Attributes:
      value: mean return.
      error: its standard error.
      episodes: that were simulated.
    """

    value: float
    error: float
    episodes: int


def rule_text(rule: PlanRule, claim: Simulated) -> dict[str, str]:
    """Both as the text of a file."""
    figures = {
        "patience": rule.patience,
        "others": rule.others,
        "decay": rule.prices.decay,
        "tries": rule.prices.tries,
        "samples": rule.samples,
        "searches": rule.searches,
        "value": claim.value,
        "error": claim.error,
        "episodes": claim.episodes,
    }
    return {_KEY: json.dumps(figures)}


def parse_rule(metadata: Mapping[str, Any]) -> tuple[PlanRule, Simulated]:
    """What `rule_text` has written.

    Raises:
      KeyError, TypeError, ValueError: if it is nothing of the kind.
    """
    figures = json.loads(metadata[_KEY])
    patience, others, decay, value, error = (
        float(figures[name]) for name in ("patience", "others", "decay", "value", "error")
    )
    tries, samples, episodes = (figures[name] for name in ("tries", "samples", "episodes"))
    # a file of before there were searches has none
    searches = figures.get("searches", False)
    for name, truth in (("tries", tries), ("searches", searches)):
        if not isinstance(truth, bool):
            raise ValueError(f"its {name} cannot be what was saved")
    for name, count in (("samples", samples), ("episodes", episodes)):
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= _MOST:
            raise ValueError(f"its {name} cannot be what was saved")
    if not math.isfinite(value) or not 0.0 <= error < math.inf:
        raise ValueError("its return cannot be what was saved")
    rule = PlanRule(patience, others, Prices(decay, tries), samples, searches)
    return rule, Simulated(value, error, episodes)
