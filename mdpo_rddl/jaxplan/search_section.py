"""The section `[Search]` of a configuration: how the recipe of `mdpo_rddl.auto` spends its time."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Search:
    """Shares of the time that is left of `[Optimize] train_seconds` once the model was probed.

    Attributes:
      shared_until: where the search for the shared weights ends.
      own_until: where the search for each object's own weights ends.
      gradient_until: where the gradient's part ends; the rest is for another search.
      alternatives: whether JaxPlan's default planners are tried in a second process.

    Raises:
      ValueError: if the shares are not in order between 0 and 1.
    """

    shared_until: float = 0.25
    own_until: float = 0.4
    gradient_until: float = 0.85
    alternatives: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.shared_until <= self.own_until <= self.gradient_until <= 1.0:
            raise ValueError("0 < shared_until <= own_until <= gradient_until <= 1 must hold")
        if not isinstance(self.alternatives, bool):
            raise ValueError(f"alternatives: must be True or False, got {self.alternatives!r}")
