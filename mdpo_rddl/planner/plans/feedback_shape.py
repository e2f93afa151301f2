"""What a feedback policy is made of."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real

_MOST = {"lifted": 1024, "pairs": 100_000}


@dataclass(frozen=True)
class FeedbackShape:
    """What a feedback policy is made of.

    Attributes:
      topology: units of the net's hidden layers; none for no net.
      cosines: number of features cos(pi k t / H), k = 1, 2, ...: a little of an open-loop plan.
      squares: whether the squares of the state features are features.
      distant: whether features also go through relations of tuples, and through two relations.
      lifted: units of a hidden layer on the features of each object, with the same weights for
        all objects; 0 for none.
      pairs: the most gains that an action fluent that is a number may have, one for each pair of
        one of its ground actions and one of all ground fluents; if there are more it has none.
      plan: whether there is a whole one, a value for every step, object and action.
      state_scales: per fluent its centre and scale; (0, 1) where it is not named.
      cut_feedback: whether a gradient takes the states that the policy reads as constant: it is
        then that of the open-loop plan that the policy has played. That is biased, since later
        reactions are left out, but it does not explode along them.
      memory: what the policy remembers, as `MemoryShape.of` reads it; nothing if None.
      lookups: fluents at objects that the state names, which the policy reads, by the names that
        `mdpo_rddl.planner.plans.lookups` gives them.

    Raises:
      ValueError: if `lifted` or `pairs` is no such number, a switch is neither True nor False, a
        scale is not above 0, or `lookups` is no list of names.
    """

    topology: Sequence[int] | None = (64, 64)
    cosines: int = 4
    squares: bool = True
    distant: bool = False
    lifted: int = 0
    pairs: int = 0
    plan: bool = False
    state_scales: Mapping[str, Sequence[float]] | None = None
    cut_feedback: bool = True
    memory: Mapping[str, Sequence[float]] | None = None
    lookups: Sequence[str] = ()

    def __post_init__(self) -> None:
        for name, most in _MOST.items():
            count = getattr(self, name)
            is_count = isinstance(count, int) and not isinstance(count, bool)
            if not (is_count and 0 <= count <= most):
                raise ValueError(f"{name}: must be a whole number from 0 to {most}, got {count!r}")
        for name in ("squares", "distant", "plan", "cut_feedback"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name}: must be True or False, got {getattr(self, name)!r}")
        is_list = isinstance(self.lookups, Sequence) and not isinstance(self.lookups, str)
        if not is_list or not all(isinstance(name, str) for name in self.lookups):
            raise ValueError(f"lookups: must be a list of names, got {self.lookups!r}")
        scales = {} if self.state_scales is None else self.state_scales
        if not isinstance(scales, Mapping):
            raise ValueError(f"state_scales: must be a dictionary, got {scales!r}")
        for fluent, pair in scales.items():
            if not _is_scale(pair):
                raise ValueError(
                    f"state_scales: {fluent} must have a centre and a scale above 0, got {pair!r}"
                )

    @property
    def layers(self) -> tuple[int, ...]:
        """Units of the hidden layers."""
        return tuple(self.topology or ())


def _is_scale(pair: object) -> bool:
    """Whether it is a centre and a scale above 0."""
    if not isinstance(pair, Sequence) or len(pair) != 2:
        return False
    if not all(isinstance(number, Real) for number in pair):
        return False
    return math.isfinite(pair[0]) and 0.0 < pair[1] < math.inf
