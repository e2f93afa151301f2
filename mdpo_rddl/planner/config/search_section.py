"""The section `[Search]` of a configuration, which asks for a race and says who takes part."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SEARCH = "Search"
"""The section's name."""
OPTIONAL_ARMS = (
    "dynamic programming",
    "relaxed plans",
    "random rules",
    "plans",
    "greedy",
    "shared weights",
    "own weights",
    "gradient",
    "plan by gradient",
    "action voting",
)
"""Arms that can be left out of the race."""


@dataclass(frozen=True)
class Search:
    """Who takes part.

    Attributes:
      without: names of arms that are left out, out of `OPTIONAL_ARMS`.

    Raises:
      ValueError: if one is unknown.
    """

    without: Sequence[str] = ()

    def __post_init__(self) -> None:
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
