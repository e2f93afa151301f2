"""The section `[Search]` of a configuration: how the recipe of `mdpo_rddl.auto` spends its time."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Search:
    """Shares of the time that is left of `[Optimize] train_seconds` once the model was probed.

    Attributes:
      shared_until: where the search for the shared weights ends.
      own_until: where the search for an open-loop plan ends, or, if none promises to become as
        good as the shared weights, that for each object's own weights.
      gradient_until: where the gradient's part ends; the rest is for another search.
      alternatives: whether JaxPlan's default planners are tried in a second process.

    Raises:
      ValueError: if the shares are not in order between 0 and 1.
    """

    shared_until: float = 0.25
    own_until: float = 0.45
    gradient_until: float = 0.85
    alternatives: bool = True

    def __post_init__(self) -> None:
        names = ("shared_until", "own_until", "gradient_until")
        shares = [0.0, *(getattr(self, name) for name in names), 1.0]
        if self.shared_until == 0.0 or shares != sorted(shares):
            raise ValueError(f"0 < {' <= '.join(names)} <= 1 must hold")
        if not isinstance(self.alternatives, bool):
            raise ValueError(f"alternatives: must be True or False, got {self.alternatives!r}")
