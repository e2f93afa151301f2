"""What a race came to: the policy, and how all arms got there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.auto.common.curve import Curve, candidate_figures, late_gain
from mdpo_rddl.auto.probing.probing import Probe
from mdpo_rddl.machine.files import finite_or_none
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.start import with_preprocessor
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.plannerless import PlannerlessPolicy
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.table import Optimum
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.load import Problem


@dataclass(frozen=True, eq=False)
class RaceOutcome:
    """What a race found.

    Attributes:
      policy: the result.
      chosen: the candidate that it was.
      judged: all candidates in the order in which the judge played them, with the seconds.
      arms: what each arm was given and did, in the order in which they began.
      probe: what constant actions have shown; None if the race ended before.
      noop_return: mean return of the no-op by the judge, or in the probe's few rollouts if it was
        not judged; None if the optimum was proven before.
      random_return: mean return of uniformly random actions; None where it is not known.
      compile_seconds: of `seconds`, spent in compilation.
      seconds: that everything took.
      interrupted: whether the race was ended early.
      earlier: the candidates of the processes that this one has gone on from.
    """

    policy: AnyPolicy
    chosen: Candidate
    judged: Sequence[Judged]
    arms: Sequence[ArmLog]
    probe: Probe | None
    noop_return: float | None
    random_return: float | None
    compile_seconds: float
    seconds: float
    interrupted: bool
    earlier: Curve = ()

    @property
    def curve(self) -> Curve:
        """All candidates, those of earlier processes among them, over the race's seconds."""
        return (*self.earlier, *map(candidate_figures, self.judged))

    @property
    def was_played(self) -> bool:
        """Whether the judge has played the result, or another policy of its planner."""
        planner = self.chosen.planner
        own = (one.candidate for one in self.judged if one.candidate.planner is planner)
        return any(candidate.returns is not None for candidate in own)

    @property
    def optimum(self) -> Optimum | None:
        """What is proven of the policy, if anything is."""
        return self.policy.optimum if isinstance(self.policy, PlannerlessPolicy) else None

    @property
    def config(self) -> PlannerConfig:
        """Of the policy's planner; of the race where the policy needs none."""
        policy = self.policy
        return self.chosen.config if isinstance(policy, PlannerlessPolicy) else policy.config

    @property
    def noise_log(self) -> ArmLog | None:
        """Of the arm that trained the result with noise on the actions, if any did."""
        if not self.chosen.uses_noise:
            return None
        return next((log for log in self.arms if log.sigma is not None), None)

    @property
    def late_gain(self) -> float | None:
        """As `curve.late_gain`; None of a proven optimum."""
        floors = map(finite_or_none, (self.noop_return, self.random_return))
        known = [floor for floor in floors if floor is not None]
        floor = max(known) if known and self.optimum is None else None
        return late_gain(self.curve, self.seconds, floor)

    def diagnostics(self) -> dict[str, Any]:
        """What was found by which arm and when, as JSON can hold it."""
        probe = self.probe
        return {
            "chosen": self.chosen.label,
            "seconds": round(self.seconds, 3),
            "arm": self.chosen.arm,
            "parents": list(self.chosen.parents),
            "noop_return": finite_or_none(self.noop_return),
            "random_return": finite_or_none(self.random_return),
            "late_gain": self.late_gain,
            "arms": {log.name: _arm(log) for log in self.arms},
            "candidates": list(self.curve),
            "units": probe.units if probe else {},
            "state_scales": _lists(probe.state_scales) if probe else {},
            "lookup_scales": _lists(probe.lookup_scales) if probe else {},
        }


def policy_of(candidate: Candidate, problem: Problem, seed: int) -> AnyPolicy:
    """A candidate as a policy, whose configuration has noise only if it was trained with it.

    Args:
      candidate: its planner is built if it has none.
      problem: the parsed problem.
      seed: of the run.
    """
    if candidate.table is not None:
        return TablePolicy(problem, *candidate.table, seed)
    if candidate.plans is not None:
        return RelaxedPlanPolicy(problem, *candidate.plans, seed, candidate.relaxed)
    planner, config = candidate.planner, candidate.config
    if planner is None:
        planner = build_planner(problem, config).planner
    if not candidate.uses_noise:
        config = config.without_noise()
    params = jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), candidate.params)
    hyperparams = with_preprocessor(planner, candidate.policy_hyperparams)
    hyperparams = jax.tree.map(np.asarray, hyperparams)
    return Policy(problem, config, params, hyperparams, seed, compiled=Compiled(planner))


def _lists(pairs: Mapping[str, tuple[float, float]]) -> dict[str, list[float]]:
    return {name: list(pair) for name, pair in pairs.items()}


def _arm(log: ArmLog) -> dict[str, Any]:
    return {
        "slices": log.slices,
        "seconds": round(log.seconds, 3),
        "compile_seconds": round(log.compile_seconds, 3),
        "iterations": log.iterations,
        "best_return": finite_or_none(log.best_return),
        **{
            name: finite_or_none(value) if isinstance(value, float) else value
            for name, value in log.details.items()
        },
    }
