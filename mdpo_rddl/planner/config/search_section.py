"""The section `[Search]` of a configuration: how the race of `mdpo_rddl.auto` spends its time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SEARCH = "Search"
"""The section's name."""
OPTIONAL_ARMS = (
    "dynamic programming",
    "relaxed plans",
    "trials",
    "greedy",
    "exploration",
    "shared weights",
    "plan",
    "own weights",
    "gradient",
    "shooting",
    "polishing the plan",
    "polishing the weights",
    "action voting",
)
"""Arms, and parts of some, that can be left out of the race."""


@dataclass(frozen=True)
class Search:
    """Shares of the time.

    The first is of all of `[Optimize] train_seconds`, the others are of what is left of it once
    the model was probed.

    Attributes:
      optimum_until: how long exact dynamic programming is tried where states and actions are
        discrete and observed; 0 for not at all.
      shared_until: where the search for the shared weights ends.
      own_until: where the search for an open-loop plan ends, or, if none promises to become as
        good as the shared weights, that for each object's own weights.
      rounds_until: where the rounds end; the rest is for the arm of the best policy.
      without: names of arms that are left out, out of `OPTIONAL_ARMS`.

    Raises:
      ValueError: if the shares are not in order between 0 and 1.
    """

    optimum_until: float = 0.4
    shared_until: float = 0.2
    own_until: float = 0.32
    rounds_until: float = 0.92
    without: Sequence[str] = ()

    def __post_init__(self) -> None:
        names = ("shared_until", "own_until", "rounds_until")
        shares = [0.0, *(getattr(self, name) for name in names), 1.0]
        if self.shared_until == 0.0 or shares != sorted(shares):
            raise ValueError(f"0 < {' <= '.join(names)} <= 1 must hold")
        if not 0.0 <= self.optimum_until < 1.0:
            raise ValueError(f"0 <= optimum_until < 1 must hold, got {self.optimum_until!r}")
        if unknown := [name for name in self.without if name not in OPTIONAL_ARMS]:
            raise ValueError(f"without: {unknown[0]!r} is none of {', '.join(OPTIONAL_ARMS)}")


def read_search(sections: Mapping[str, Mapping[str, Any]]) -> Search | None:
    """What the section says; None where a configuration has none.

    Args:
      sections: per section of the configuration, its keys and literal values.

    Raises:
      TypeError: if there is a key that is unknown.
      ValueError: if a value is refused, or the plan is one that the race cannot search.
    """
    if SEARCH not in sections:
        return None
    search = Search(**sections[SEARCH])
    if sections["Planner"].get("method") != "FeedbackPlan":
        raise ValueError("needs method='FeedbackPlan' in [Planner]")
    return search
