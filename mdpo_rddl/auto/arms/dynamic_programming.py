"""The arm that proves its policy to be the best one there is."""

import logging

from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.search.optimum import Solution, find_optimum
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.problem.enumeration.grounded import Grounded
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

DYNAMIC_PROGRAMMING = "dynamic programming"
PROVEN = "proven optimum"
_MEMORY_GB = 4.0


class DynamicProgrammingArm(Arm):
    """Enumerates the reachable states, and goes backward through the steps.

    Attributes:
      solution: the optimum, once it is found.
      proven: the same as a candidate.
      grounded: the ground models, once there are any, whether they were enumerated or not.
    """

    def __init__(
        self, problem: Problem, config: PlannerConfig, clock: Clock, keeps_values: bool = False
    ) -> None:
        """Does nothing yet.

        Args:
          problem: with discrete, observed states and discrete actions.
          config: of the race.
          clock: what is asked for the time.
          keeps_values: whether the table has the states' values.
        """
        super().__init__(DYNAMIC_PROGRAMMING, clock)
        self._keeps_values = keeps_values
        self._problem, self._config = problem, config
        self.solution: Solution | None = None
        self.proven: Candidate | None = None
        self.grounded = Grounded(problem)

    def ground(self, until: float) -> None:
        """Makes the models for others, where no optimum is looked for.

        Args:
          until: when to end, by the clock.
        """
        try:
            limits = EnumerationLimits(until - self._clock(), clock=self._clock)
            self.grounded.ground(limits)
        except Exception as error:  # the other arms need none
            logger.info("no ground model: %s", one_line_cause(error))

    def _work(self, until: float) -> None:
        seconds = until - self._clock()
        try:
            given = _MEMORY_GB, self._clock, self.grounded, self._keeps_values
            solution = find_optimum(self._problem, seconds, *given)
        except NotEnumerableError as error:
            self._give_up(str(error))
            return
        except Exception as error:  # the other arms need no enumeration
            self._give_up(f"{type(error).__name__}: {one_line_cause(error)}")
            return
        self.proven = Candidate(
            arm=self.name,
            label=PROVEN,
            config=self._config,
            planner=None,
            params=None,
            mean=solution.value,
            error=0.0,
        )
        self.solution = solution
        self._log.iterations += self._problem.horizon
        self._log.details = {"states": solution.optimum.states}
        self._offer(self.proven)

    def _give_up(self, cause: str) -> None:
        logger.info("no exact dynamic programming: %s", cause)
        self._log.details = {**self._log.details, "cause": cause}
