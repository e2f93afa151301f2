"""The arms that train JaxPlan's own classes of policies in our calls, each on its own line."""

import logging
import math

import jax
import jax.numpy as jnp

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.trained import REPLAY_SECONDS, TrainedArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.state import UNFIT, State, count_of, joined
from mdpo_rddl.auto.common.training_state import BestIterate, checkpoints_of, state_of
from mdpo_rddl.auto.search.steps import has_stalled, step_factor
from mdpo_rddl.errors import Cancelled, InputError, note_heard
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training.training import Record, Training, TrainingResult
from mdpo_rddl.planner.update.restarts import PerRestart

logger = logging.getLogger(__name__)

_FOREVER = 1e9
# from one look at what a phase gains to the next
_LOOKING_SECONDS = 0.5


class TrainingArm(TrainedArm):
    """Follows the relaxed model's gradient on a straight-line plan or a deep reactive policy.

    Compilation goes on in a thread while other arms work, for nothing interrupts it. Each slice
    goes on with the training of the last. Where nothing more is gained, another phase begins at the
    best iterate, with another step size (`search/steps.py`).
    """

    def __init__(self, arena: Arena, method: str, usual_seconds: float = 0.0) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common.
          method: out of `METHODS`, the arm's name as well.
          usual_seconds: what its program is likely to take to compile.
        """
        super().__init__(method, arena, usual_seconds)
        self._best: BestIterate | None = None
        self._records: tuple[Record, ...] = ()
        self._iterations = self._phase = 0
        self._offered = self._best_iteration = -1

    def state(self) -> State | None:
        """The phase's training, and the best iterate of all phases."""
        training, best = self._training, self._best
        latest = None if training is None else training.state()
        if latest is None or best is None:
            return self._resumed
        values = {
            "phase": self._phase,
            "iterations": self._iterations,
            "best_iteration": self._best_iteration,
        }
        return joined(
            State({}, values), best.state().within("best"), state_of(latest).within("training")
        )

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
                while not self._training.has_ended:
                    left = until - self._clock()
                    self._training.advance(min(left, _LOOKING_SECONDS))
                    result = self._noted(self._training)
                    self._resumed = None  # it fits
                    if self._training.has_ended or self._clock() >= until:
                        break
                    if has_stalled(result.iterations, result.best_iteration):
                        self._begin_phase()
                self._offer_best(self._training, until)
        except InputError as error:
            if self._resumed is not None:
                self._begin_anew(error)
                return
            # other arms find a policy without this one, or it has found one in an earlier phase
            logger.info("%s is of no use: %s", self.name, error)
            self._log.details = {**self._log.details, "cause": str(error)}
            self._offer_known(until)
            self.is_exhausted = not self.awaits_judge
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            if self._is_judged:
                self._offer_known(self._clock())  # nobody waits for a compilation now
            raise

    def _begin_anew(self, error: InputError) -> None:
        """Where the state of another process turns out not to fit."""
        logger.info("%s: its state is left out: %s", self.name, error)
        self._resumed = self._best = None
        self._estimate = -math.inf
        self._put_back()
        self._begin()

    def _put_back(self) -> None:
        """Leaves the planner as the first phase has it."""
        self.close()
        self._training, self._phase, self._iterations = None, 0, 0
        self._built.planner.vary_restarts()

    def _compile(self, seconds: float) -> None:
        if self._resumed is not None and self._try(
            lambda state: self._go_on(state, seconds), self._resumed
        ):
            return
        built = self._built
        if (guess := self._earlier_params(built.planner)) is not None:
            built = built.with_arguments(guess=guess)
        self._training = self._compiled_training(built, seconds)

    def _go_on(self, state: State, seconds: float) -> None:
        """Compiles the phase's training, which goes on with the state."""
        built, values = self._built, state.values
        best = BestIterate.of(state.part("best"), built.planner)
        phase, iterations = count_of(values["phase"]), count_of(values["iterations"])
        best_iteration = count_of(values["best_iteration"])
        self._phase, self._iterations = phase, iterations
        try:
            if phase:
                built = self._with_smaller_steps(built, best)
            self._training = self._compiled_training(built, seconds, state.part("training"))
        except (InputError, *UNFIT):
            self._put_back()
            raise
        self._best, self._best_iteration = best, best_iteration
        self._estimate = best.mean_return

    @property
    def _built(self) -> Built[MDPOPlanner]:
        return self._arena.plain.built(self.name)

    def _compiled_training(
        self, built: Built[MDPOPlanner], seconds: float, state: State | None = None
    ) -> Training:
        arena = self._arena
        key = jax.random.fold_in(key_for(Draws.TRAINING, arena.seed), self._phase)
        left = max(1, arena.most_iterations - self._iterations)
        budget = Budget(left, seconds)
        training = Training(built, key, budget, arena.tell, checkpoints_of(state))
        training.compile()
        # the arm's slices end it
        training.limit(_FOREVER)
        return training

    def _begin_phase(self) -> None:
        """Goes on from the best iterate with another step size, if the optimiser has one."""
        built, best = self._built, self._best
        rate = built.planner.optimizer_kwargs.get("learning_rate")
        if rate is None or best is None or self._log.iterations >= self._arena.most_iterations:
            return
        assert self._training is not None
        self._training.close()
        self._iterations, self._records = self._log.iterations, self._log.records
        self._phase += 1
        left = max(1.0, self._arena.deadline - self._clock())
        self._training = self._compiled_training(self._with_smaller_steps(built, best), left)

    def _with_smaller_steps(
        self, built: Built[MDPOPlanner], best: BestIterate
    ) -> Built[MDPOPlanner]:
        """What a later phase trains: it begins at the best iterate, with its own step size."""
        planner = built.planner
        count, rate = planner.parallel_updates, planner.optimizer_kwargs["learning_rate"]
        planner.vary_restarts(learning_rate=[rate * step_factor(self._phase)] * count)
        guess = jax.tree.map(lambda leaf: jnp.stack([jnp.asarray(leaf)] * count), best.params)
        return built.with_arguments(guess=PerRestart(guess))

    def _noted(self, training: Training) -> TrainingResult:
        """What the phase has found so far, which is kept if it is the best of all phases."""
        result, done = training.result(seconds=REPLAY_SECONDS), self._iterations
        self._note_not_finite(training, result)
        history = (r._replace(iteration=r.iteration + done) for r in result.history)
        self._log.iterations = done + result.iterations
        self._log.records = (*self._records, *history)
        if result.best_return > self._estimate or self._best is None:
            self._estimate = result.best_return
            self._best = BestIterate(
                result.best_params, result.policy_hyperparams, result.best_return
            )
            self._best_iteration = done + result.best_iteration
        return result

    def _offer_best(self, training: Training, until: float) -> None:
        is_interrupted = self._noted(training).status == "interrupted"
        if is_interrupted and not self._is_judged:
            raise Cancelled  # whoever interrupts does not wait for a compilation
        self._offer_known(until)
        if is_interrupted:
            raise Cancelled
        self.is_exhausted = training.has_ended and not self.awaits_judge

    def _offer_known(self, until: float) -> None:
        """Hands in the best policy of all phases, if the judge can play it and has not yet."""
        best, arena = self._best, self._arena
        if best is None or self._best_iteration == self._offered:
            return
        planner = self._built.planner
        if not self._may_be_judged(planner, best.params, until):
            return
        self._offered = self._best_iteration
        self._offer(
            Candidate(
                arm=self.name,
                label=f"{self.name}, iteration {self._best_iteration:,}",
                config=arena.plain.config(self.name),
                planner=planner,
                params=best.params,
                policy_hyperparams=best.policy_hyperparams,
            )
        )
