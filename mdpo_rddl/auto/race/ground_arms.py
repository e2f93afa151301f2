"""The arms that work on the ground model, before anything is compiled.

There are none where the environment raises errors: a ground model has no laws but those on which a
reward or a state depends.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.arms.dynamic_programming import DynamicProgrammingArm
from mdpo_rddl.auto.arms.relaxed_plans import RELAXED_PLANS, RelaxedPlansArm
from mdpo_rddl.auto.arms.trials import TRIALS, TrialsArm
from mdpo_rddl.auto.race.options import RaceOptions
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import Search as Shares
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.load import Problem

# of the time: a first slice of the relaxed plans, and those of the trials; the former's most slices
_PLANS_SHARE, _TRIALS_SHARES = 0.08, (0.04, 0.06)
_PLANS_SLICES = 2


@dataclass
class GroundArms:
    """Those that there are.

    Attributes:
      exact: looks for the optimum.
      plans: makes relaxed plans.
      trials: searches by trials where states are too many to be enumerated.
    """

    exact: DynamicProgrammingArm | None = None
    plans: RelaxedPlansArm | None = None
    trials: TrialsArm | None = None

    @property
    def all(self) -> tuple[Arm, ...]:
        """In the order in which they work."""
        arms = self.exact, self.plans, self.trials
        return tuple(arm for arm in arms if arm is not None)


class GroundSlices:
    """Gives them their first slices."""

    def __init__(
        self,
        problem: Problem,
        config: PlannerConfig,
        seed: int,
        options: RaceOptions,
        shares: Shares,
    ) -> None:
        """Makes what looks for the optimum, where that has a prospect.

        Args:
          problem: the parsed problem.
          config: of the race.
          seed: of everything that is drawn.
          options: of the race.
          shares: of the time, and which arms are left out.
        """
        self.arms = GroundArms()
        self._problem, self._config, self._seed = problem, config, seed
        self._options, self._shares, self._clock = options, shares, options.clock
        if shares.optimum_until > 0.0 and is_discrete(problem) and not problem.raises:
            self.arms.exact = DynamicProgrammingArm(problem, config, self._clock)

    def enumerate(self, deadline: float) -> None:
        """Looks for the optimum for a share of what is left.

        An arm that has given up has made the ground models, which others need.

        Args:
          deadline: when the race ends, by the clock.
        """
        exact, now = self.arms.exact, self._clock()
        assert exact is not None
        self._options.on_pulse()
        until = now + self._shares.optimum_until * max(0.0, deadline - now)
        if exact.name in self._shares.without:
            exact.ground(until)
        else:
            exact.work(until)

    def search(self, deadline: float, on_stage: Callable[[str], None]) -> None:
        """Relaxed plans, then trials, if there is a ground model.

        Args:
          deadline: when the race ends, by the clock.
          on_stage: called with the name of each part as it begins.
        """
        exact, without = self.arms.exact, self._shares.without
        assert exact is not None
        given = self._config, self._seed, self._clock
        opened, model = exact.grounded.opened, exact.grounded.model
        if opened is not None and RELAXED_PLANS not in without:
            on_stage("searching")
            self.arms.plans = RelaxedPlansArm(*given, opened, self._options.on_pulse)
            for _ in range(_PLANS_SLICES):
                if self.arms.plans.is_undecided:
                    self.arms.plans.work(min(self._until(_PLANS_SHARE), deadline))
        if model is not None and TRIALS not in without:
            on_stage("searching")
            more = model, self._options.on_pulse
            self.arms.trials = TrialsArm(self._problem, *given, *more)
            self._begin(self.arms.trials, deadline)

    def _begin(self, trials: TrialsArm, deadline: float) -> None:
        """Two slices, of which the second is given only to what promises something.

        They need no compilation and thus come before it.
        """
        for share in _TRIALS_SHARES:
            if not trials.is_exhausted:
                trials.work(min(self._until(share), deadline))

    def _until(self, share: float) -> float:
        """The end of a share of the race's time that begins now."""
        return self._clock() + share * self._config.budget().seconds
