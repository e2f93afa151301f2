"""The arms that train JaxPlan's own classes of policies in our calls, each on its own line."""

import logging
import math

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import CompilingArm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.draws import Draws, key_for
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.training import Training

logger = logging.getLogger(__name__)

METHODS = ("slp", "drp")
_FOREVER = 1e9


class TrainingArm(CompilingArm):
    """Follows the relaxed model's gradient on a straight-line plan or a deep reactive policy.

    Compilation goes on in a thread while other arms work, for nothing interrupts it. Each slice
    goes on with the training of the last.
    """

    def __init__(self, arena: Arena, method: str, usual_seconds: float = 0.0) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common.
          method: "slp" or "drp", the arm's name as well.
          usual_seconds: what its program is likely to take to compile.
        """
        super().__init__(method, arena, usual_seconds)
        self._training: Training | None = None
        self._offered = -1

    def _begin(self) -> None:
        seconds = max(1.0, self._arena.deadline - self._clock())
        self._start(lambda: self._compile(seconds))

    def _work(self, until: float) -> None:
        """Waits for the compilation, and trains for what is left of the slice.

        Raises:
          Cancelled: if interrupted; what was found till then is offered.
        """
        try:
            if self._is_compiled(until):
                assert self._training is not None
                if not self._training.has_ended:
                    self._training.advance(until - self._clock())
                self._offer_best(self._training, until)
        except InputError as error:
            # other arms find a policy without this one
            logger.info("%s is of no use: %s", self.name, error)
            self._log.details = {"cause": str(error)}
            self.is_exhausted = True

    def _compile(self, seconds: float) -> None:
        arena = self._arena
        built = arena.plain.built(self.name)
        if (guess := self._earlier_params(built.planner)) is not None:
            built = built.with_arguments(guess=guess)
        key = key_for(Draws.TRAINING, arena.seed)
        budget = Budget(arena.most_iterations, seconds)
        training = Training(built, key, budget, arena.tell)
        training.compile()
        # the arm's slices end it
        training.limit(_FOREVER)
        self._training = training

    def _offer_best(self, training: Training, until: float) -> None:
        result, arena = training.result(), self._arena
        planner = arena.plain.built(self.name).planner
        self._log.iterations = result.iterations
        self._log.records = result.history
        returns = [record.test_return for record in result.history]
        self._estimate = max(filter(math.isfinite, returns), default=-math.inf)
        is_interrupted = result.status == "interrupted"
        if is_interrupted and not self._is_judged:
            self.is_exhausted = True
            raise Cancelled  # whoever interrupts does not wait for a compilation
        is_new = result.best_iteration != self._offered
        if is_new and self._may_be_judged(planner, result.best_params, until):
            self._offered = result.best_iteration
            self._offer(
                Candidate(
                    arm=self.name,
                    label=f"{self.name}, iteration {result.best_iteration:,}",
                    config=arena.plain.config(self.name),
                    planner=planner,
                    params=result.best_params,
                    policy_hyperparams=result.policy_hyperparams,
                )
            )
        self.is_exhausted = training.has_ended and not self.awaits_judge
        if is_interrupted:
            raise Cancelled
