"""What a race came to: the policy, and how all arms got there."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.machine.files import finite_or_none
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.plannerless import PlannerlessPolicy
from mdpo_rddl.policy.table import Optimum
from mdpo_rddl.problem.evaluation import mean_and_error
from mdpo_rddl.race.arm import Candidate

Curve = Sequence[Mapping[str, Any]]
"""Each candidate as `Point.figures` has it, in the order in which they were judged."""


class Point(NamedTuple):
    """A candidate at the time when the evaluator played it.

    Attributes:
      candidate: the policy.
      returns: of its episodes [N].
      seconds: since the race began.
      became_incumbent: whether it was better than all before it, by what is known of them now.
    """

    candidate: Candidate
    returns: np.ndarray
    seconds: float
    became_incumbent: bool

    @property
    def mean(self) -> float:
        """Of the returns."""
        return float(np.mean(self.returns))

    def figures(self) -> dict[str, Any]:
        """As JSON can hold it; None for a return that is not finite."""
        mean, error = mean_and_error(self.returns)
        return {
            "seconds": round(self.seconds, 3),
            "arm": self.candidate.arm,
            "candidate": self.candidate.label,
            "mean_return": finite_or_none(mean),
            "error": finite_or_none(error),
            "became_incumbent": self.became_incumbent,
        }


class ArmFigures(NamedTuple):
    """What an arm was given and what it did.

    Attributes:
      name: the arm's.
      slices: of time that it was given.
      seconds: of all of them.
      iterations: in all slices.
      best_return: the evaluator's mean return of its best candidate; None before the first.
      details: what else there is to say, as JSON can hold it.
    """

    name: str
    slices: int
    seconds: float
    iterations: int
    best_return: float | None
    details: Mapping[str, Any]


class Outcome(NamedTuple):
    """What a race found.

    Attributes:
      policy: the result.
      chosen: the candidate that it was.
      confirmed: its returns in episodes that no candidate was chosen by [N]; empty if there was no
        time for them.
      points: all candidates in the order in which they were judged.
      arms: what each arm was given and did, in the order in which they began.
      units, state_scales, lookup_scales: as in `mdpo_rddl.race.probe.Probe`.
      noop_return: mean return of the no-op; None if an optimum was proven before it was played.
      random_return: mean return of uniformly random actions; None where it is not known.
      seconds: that everything took.
      interrupted: whether the race was ended early.
      earlier: the candidates of the processes that this one has gone on from.
    """

    policy: AnyPolicy
    chosen: Candidate
    confirmed: np.ndarray
    points: Sequence[Point]
    arms: Sequence[ArmFigures]
    units: Mapping[str, float]
    state_scales: Mapping[str, tuple[float, float]]
    lookup_scales: Mapping[str, tuple[float, float]]
    noop_return: float | None
    random_return: float | None
    seconds: float
    interrupted: bool
    earlier: Curve = ()

    @property
    def curve(self) -> Curve:
        """All candidates, those of earlier processes among them, over the race's seconds."""
        return (*self.earlier, *(point.figures() for point in self.points))

    @property
    def optimum(self) -> Optimum | None:
        """What is proven of the policy, if anything is."""
        return self.policy.optimum if isinstance(self.policy, PlannerlessPolicy) else None

    @property
    def late_gain(self) -> float | None:
        """What the best policy has gained in the last half, as a share of all that it has gained.

        About 0 where more time is of no use; 1 where all was found late; None where nothing was
        gained, the optimum is proven, or it is not known.
        """
        floors = [finite_or_none(each) for each in (self.noop_return, self.random_return)]
        known = [floor for floor in floors if floor is not None]
        best = [p for p in self.curve if p["became_incumbent"] and p["mean_return"] is not None]
        if not known or not best or self.optimum is not None:
            return None
        floor, last = max(known), best[-1]["mean_return"]
        if not last > floor:
            return None
        early = [p["mean_return"] for p in best if p["seconds"] <= self.seconds / 2.0]
        before = max(floor, early[-1]) if early else floor
        return float(max(0.0, last - before) / (last - floor))

    def diagnostics(self) -> dict[str, Any]:
        """What was found by which arm and when, as JSON can hold it."""
        return {
            "chosen": self.chosen.label,
            "seconds": round(self.seconds, 3),
            "arm": self.chosen.arm,
            "parents": list(self.chosen.parents),
            "noop_return": finite_or_none(self.noop_return),
            "random_return": finite_or_none(self.random_return),
            "late_gain": self.late_gain,
            "arms": {each.name: _arm(each) for each in self.arms},
            "candidates": list(self.curve),
            "units": dict(self.units),
            "state_scales": {name: list(pair) for name, pair in self.state_scales.items()},
            "lookup_scales": {name: list(pair) for name, pair in self.lookup_scales.items()},
        }


def _arm(figures: ArmFigures) -> dict[str, Any]:
    return {
        "slices": figures.slices,
        "seconds": round(figures.seconds, 3),
        "iterations": figures.iterations,
        "best_return": finite_or_none(figures.best_return),
        **{
            name: finite_or_none(value) if isinstance(value, float) else value
            for name, value in figures.details.items()
        },
    }
