"""The best policies of a race that was stopped, with which another one goes on."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.common.candidate import Candidate, has_structure
from mdpo_rddl.auto.common.curve import Curve
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.file import SavedTable, problem_identity
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.table import ActionTable, Estimate
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.load import Problem

# of the race, which may have had less time left than the one that it goes on from
_SECONDS = ("Optimize", "train_seconds")


@dataclass(frozen=True)
class EarlierPolicy:
    """A judged policy without its planner.

    Attributes:
      config: of its planner.
      params: of one policy, nested dictionaries of arrays; None of one without a planner.
      policy_hyperparams: JaxPlan's policy hyperparameters.
      arm, label, parents, uses_noise, mean, error, table, plans: as of a `Candidate`.
    """

    config: PlannerConfig
    params: Any
    policy_hyperparams: Mapping[str, Any]
    arm: str
    label: str
    parents: tuple[str, ...]
    uses_noise: bool
    mean: float
    error: float
    table: tuple[ActionTable, Estimate] | None = None
    plans: tuple[PlanRule, Simulated] | None = None

    def candidate(self, arena: Arena) -> Candidate:
        """The policy as a candidate: of the arena's planner where it fits, to be judged anew.

        Else, and on a large problem, it keeps what the earlier judge has said, whose rollouts had
        the same seed. So does what needs no planner.

        Raises:
          InputError: if a table is not of the arena's problem.
        """
        if self.table is not None or self.plans is not None:
            return self.known(arena.problem, arena.seed)
        fits = _plain(self.config) == _plain(arena.config)
        fits = fits and has_structure(arena.planner, self.params, self.policy_hyperparams)
        is_judged = fits and arena.probe.policy_seconds is None
        return Candidate(
            arm=self.arm,
            label=self.label,
            config=arena.config if fits else self.config,
            planner=arena.planner if fits else None,
            params=self.params,
            policy_hyperparams=self.policy_hyperparams,
            parents=self.parents,
            uses_noise=self.uses_noise,
            mean=None if is_judged else self.mean,
            error=float("inf") if is_judged else self.error,
        )

    def known(self, problem: Problem, seed: int) -> Candidate:
        """The policy with what the earlier judge has said, as a candidate without a planner.

        Args:
          problem: that is planned.
          seed: of the run.

        Raises:
          InputError: if a table is not of the problem.
        """
        if self.table is not None:
            saved = SavedTable(*self.table, problem_identity(problem), seed)
            TablePolicy.from_saved(saved, problem, "the checkpoint")  # raises
        return Candidate(
            arm=self.arm,
            label=self.label,
            config=self.config,
            planner=None,
            params=self.params,
            policy_hyperparams=self.policy_hyperparams,
            parents=self.parents,
            uses_noise=self.uses_noise,
            table=self.table,
            plans=self.plans,
            mean=self.mean,
            error=self.error,
        )


@dataclass(frozen=True)
class EarlierRace:
    """What a race has left.

    Attributes:
      seconds: that it had used.
      incumbent: its best policy.
      others: the best policy of each other arm.
      curve: all candidates that it had judged.
    """

    seconds: float
    incumbent: EarlierPolicy
    others: tuple[EarlierPolicy, ...] = ()
    curve: Curve = ()

    def candidates(self, arena: Arena) -> list[Candidate]:
        """The policies as candidates, the incumbent first.

        One whose return is only an estimate of a few episodes, without an error, is left out
        unless it is judged anew: nothing would be better for certain.
        """
        found = [policy.candidate(arena) for policy in (self.incumbent, *self.others)]
        return [each for each in found if each.mean is None or math.isfinite(each.error)]


def _plain(config: PlannerConfig) -> str:
    """What a configuration says of the policy, whatever noise it was trained with, and how long."""
    return config.without_noise().without_values(*_SECONDS).to_text()
