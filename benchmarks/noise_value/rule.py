"""When noise pays: a threshold on one sign, found on some problems and tested on the others."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.noise_value.signs import SIGNS

MARGIN = 0.01
"""By how much of the normalised score noise must be ahead to pay."""


@dataclass(frozen=True)
class Case:
    """One problem, plan and configuration.

    Attributes:
      family: what is before the first underscore of the problem's name; its problems are alike.
      signs: per name of `SIGNS` its value.
      lead: by how much noise is ahead in normalised score.
    """

    family: str
    signs: Mapping[str, float]
    lead: float

    @property
    def pays(self) -> bool:
        """Whether noise is ahead by the margin."""
        return self.lead > MARGIN

    @property
    def is_held_out(self) -> bool:
        """Whether the rule is tested on it: by a hash of the family, so before anything is seen."""
        return bool(hashlib.sha256(self.family.encode()).digest()[0] % 2)


@dataclass(frozen=True)
class Rule:
    """Noise pays where a sign is above a threshold, or below it.

    Attributes:
      sign: one of `SIGNS`; None for the rule that says the same of all.
      threshold: of the sign.
      above: whether noise pays above it; of the rule without a sign, whether it pays at all.
    """

    sign: str | None
    threshold: float
    above: bool

    def says(self, case: Case) -> bool:
        """Whether noise should pay there."""
        if self.sign is None:
            return self.above
        return (case.signs[self.sign] > self.threshold) == self.above

    def hits(self, cases: Sequence[Case]) -> int:
        """Of how many cases it is right."""
        return sum(self.says(case) == case.pays for case in cases)

    def __str__(self) -> str:
        if self.sign is None:
            return "everywhere" if self.above else "nowhere"
        side = "above" if self.above else "at most"
        return f"where `{self.sign}` ({SIGNS[self.sign]}) is {side} {self.threshold:.3g}"


def constant_rule(cases: Sequence[Case]) -> Rule:
    """What is right of most cases without looking at a sign."""
    return Rule(None, 0.0, 2 * sum(case.pays for case in cases) > len(cases))


def find_rule(cases: Sequence[Case]) -> Rule:
    """The rule that is right of most of the cases; of equally good ones the simplest.

    Simplest is the rule without a sign, then the order of `SIGNS`, then the smallest threshold.
    """
    rules = [constant_rule(cases)]
    for sign in SIGNS:
        values = np.unique([case.signs[sign] for case in cases])
        for threshold in (values[1:] + values[:-1]) / 2.0:
            rules += [Rule(sign, float(threshold), above) for above in (True, False)]
    return max(rules, key=lambda rule: rule.hits(cases))
