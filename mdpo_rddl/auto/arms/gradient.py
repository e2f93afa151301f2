"""The arm that follows the relaxed model's gradient: MDPO in phases, each from the best so far."""

import dataclasses
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.trained import REPLAY_SECONDS, TrainedArm
from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.state import State, count_of, joined
from mdpo_rddl.auto.common.training_state import checkpoints_of, state_of
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.training.training import Record, Training, TrainingResult
from mdpo_rddl.planner.update.restarts import PerRestart

logger = logging.getLogger(__name__)

GRADIENT = "gradient"
# of the optimiser's learning rate
_FIRST_STEPS = (0.3, 1.0, 1.0, 3.0)
_FIRST_NOISE = (0.3, 0.3, 1.0, 1.0)
_LATER_STEPS = (1.0, 0.3)
# of the step size after a phase that found nothing better
_SHRINK = 0.3
_LEAST_SECONDS = 0.1
# the arm's slices end a training
_FOREVER = 1e9


@dataclass(frozen=True, eq=False)
class PhaseLog:
    """What one phase did.

    Attributes:
      steps: step sizes, one for each restart.
      noise: factors of the noise's scale, one for each restart.
      result: of the training so far.
      candidates: labels of what it found.
    """

    steps: Sequence[float]
    noise: Sequence[float]
    result: TrainingResult
    candidates: Sequence[str]


class _Earlier(NamedTuple):
    """What had ended in another process: phases, and their iterations."""

    phases: int = 0
    iterations: int = 0


class GradientArm(TrainedArm):
    """Trains with MDPO in phases.

    The first goes from the best policy so far and from the best constant, with several step
    sizes each; the later ones from the best policy so far, with the step size that found it and
    a smaller one. A phase goes on as long as each slice of time finds something better.

    Attributes:
      phases: what was done.
    """

    descends = True

    def __init__(self, arena: Arena, usual_seconds: float = 0.0) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common; its planner has several parallel updates and an
            optimiser with a `learning_rate`.
          usual_seconds: what its program is likely to take to compile.
        """
        super().__init__(GRADIENT, arena, usual_seconds)
        self.phases: list[PhaseLog] = []
        self._parent = arena.incumbent
        self._steps: Sequence[float] = ()
        self._noise: Sequence[float] = ()
        self._best_before = -math.inf
        self._earlier = _Earlier()
        # phases of this process that are over: the latest is not in `phases` before its first slice
        self._ended = 0

    def state(self) -> State | None:
        """The phase's training, and what its restarts differ in."""
        training = self._training
        latest = None if training is None else training.state()
        if latest is None:
            return self._resumed
        done, earlier = self.phases[: self._ended], self._earlier
        values = {
            "ended": earlier.phases + len(done),
            "iterations": earlier.iterations + sum(each.result.iterations for each in done),
            "steps": list(self._steps),
            "noise": list(self._noise),
        }
        return joined(State({}, values), state_of(latest).within("training"))

    @property
    def log(self) -> ArmLog:
        """With the recorded iterations of all phases, one after the other."""
        log, done = self._log, self._earlier.iterations
        records: list[Record] = []
        for phase in self.phases:
            records += [r._replace(iteration=r.iteration + done) for r in phase.result.history]
            done += phase.result.iterations
        if self.phases:
            log.records, log.iterations = tuple(records), done
            log.sigma = np.concatenate([phase.result.sigma for phase in self.phases])
        # what an earlier process has told stays until there is a phase of this one
        told = log.details.get("phases", []) if not self.phases else map(self._summary, self.phases)
        log.details = {**log.details, "phases": list(told)}
        return log

    def _work(self, until: float) -> None:
        """Goes on with the phase, or begins the next; at first it may only wait.

        Raises:
          Cancelled: if interrupted; what was found till then is offered.
        """
        try:
            assert self._training is not None
            if self._training.train_seconds and not self._goes_on():
                self._begin()
            self._best_before = self._arena.judge.best_mean
            if self._is_compiled(until):
                self._train(until)
                self._resumed = None  # it fits
        except InputError as error:
            if self._resumed is not None:
                logger.info("%s: its state is left out: %s", self.name, error)
                self._resumed, self._earlier = None, _Earlier()
                self._begin()
                return
            # other arms find a policy without the gradient
            logger.warning("the gradient is of no use: %s", error)
            self.is_exhausted = True

    def _goes_on(self) -> bool:
        """Whether the phase has more to find."""
        found = self._log.best_return
        is_better = found is not None and found > self._best_before
        return is_better and self._training is not None and not self._training.has_ended

    def _begin(self) -> None:
        """Begins a phase, or goes on with that of another process."""
        arena, number = self._arena, self._earlier.phases + len(self.phases)
        self._parent = best = arena.incumbent
        if self._training is not None:
            self._training.close()
        if self._resumed is not None and self._try(self._go_on, self._resumed):
            return
        starts = [best.params] if number else [best.params, arena.constant]
        self._steps, self._noise = self._steps_and_noise(arena.planner)
        self._begin_training(number, starts)

    def _go_on(self, state: State) -> None:
        """Begins the training with a state."""
        values, count = state.values, self._arena.planner.parallel_updates
        earlier = _Earlier(count_of(values["ended"]), count_of(values["iterations"]))
        steps, noise = (list(map(float, values[name])) for name in ("steps", "noise"))
        if len(steps) != count or len(noise) != count:
            raise ValueError(f"its steps are not those of {count} restarts")
        for value in (*steps, *noise):
            if not 0.0 < value < math.inf:
                raise ValueError(f"a step or noise is {value}, and not between 0 and infinity")
        self._steps, self._noise = steps, noise
        self._begin_training(earlier.phases, [self._parent.params], state.part("training"))
        self._earlier = earlier

    def _begin_training(
        self, number: int, starts: Sequence[Params], state: State | None = None
    ) -> None:
        """Compiles in a thread, for nothing interrupts that.

        Args:
          number: of phases before this one.
          starts: what the restarts begin with.
          state: with which the training goes on, if it does.
        """
        arena, planner = self._arena, self._arena.planner
        guesses = _spread(starts, planner.parallel_updates)
        planner.vary_restarts(learning_rate=self._steps, noise=_scaled_noise(planner, self._noise))
        training = Training(
            Built(planner, arguments={"guess": _stack(guesses), "test_rolling_window": 1}),
            jax.random.fold_in(key_for(Draws.GRADIENT, arena.seed), number),
            Budget(arena.most_iterations, max(_LEAST_SECONDS, arena.deadline - self._clock())),
            arena.tell,
            checkpoints_of(state),
        )
        is_first = self._training is None
        self._training, self._ended = training, len(self.phases)
        # a later phase has the first one's program
        self._start(training.compile, in_turn=is_first)

    def _train(self, until: float) -> None:
        training = self._training
        assert training is not None
        if not training.train_seconds:
            training.limit(_FOREVER)
        training.advance(until - self._clock())
        result = training.result(seconds=REPLAY_SECONDS)
        self._note_not_finite(training, result)
        number = self._earlier.phases + self._ended + 1
        labels = f"phase {number}", f"phase {number}, last iterate"
        self.phases[self._ended :] = [PhaseLog(self._steps, self._noise, result, labels)]
        for label, params in zip(labels, (result.best_params, result.last_params), strict=True):
            self._offer(self._trained(self._parent, label, params, result))
        if result.status == "interrupted":
            raise Cancelled

    def _trained(
        self, parent: Candidate, label: str, params: Params, result: TrainingResult
    ) -> Candidate:
        child = parent.child(self.name, label, params)
        parents = tuple(name for name in child.parents if name)
        noisy = child.uses_noise or not self._arena.planner.noise.silent
        hyperparams = result.policy_hyperparams
        return dataclasses.replace(
            child, parents=parents, uses_noise=noisy, policy_hyperparams=hyperparams
        )

    def _steps_and_noise(self, planner: MDPOPlanner) -> tuple[list[float], list[float]]:
        """Step sizes and factors of the noise, one for each restart."""
        count = planner.parallel_updates
        if not self.phases:
            rate = planner.optimizer_kwargs["learning_rate"]
            steps = [rate * factor for factor in _repeated(_FIRST_STEPS, count)]
            return steps, _repeated(_FIRST_NOISE, count)
        last = self.phases[-1]
        restart = last.result.restart
        if self._improved(last):
            step, noise = last.steps[restart], last.noise[restart]
        else:
            step, noise = max(last.steps) * _SHRINK, max(last.noise)
        steps = [step * factor for factor in _repeated(_LATER_STEPS, count)]
        return steps, [noise * _SHRINK] * count

    def _improved(self, phase: PhaseLog) -> bool:
        """Whether a phase found a better policy than all before it."""
        return any(self._arena.judge.became_incumbent(label) for label in phase.candidates)

    def _summary(self, phase: PhaseLog) -> dict[str, Any]:
        return {
            "iterations": phase.result.iterations,
            "step": phase.steps[phase.result.restart],
            "seconds": round(phase.result.train_seconds, 2),
            "improved": self._improved(phase),
        }


def _spread(starts: Sequence[Params], count: int) -> list[Params]:
    """So many of the starts, each as often."""
    return [starts[number * len(starts) // count] for number in range(count)]


def _repeated(values: Sequence[float], count: int) -> list[float]:
    """So many of the values, in turn."""
    return [values[number % len(values)] for number in range(count)]


def _stack(guesses: Sequence[Params]) -> PerRestart:
    return PerRestart(jax.tree.map(lambda *leaves: jnp.stack(leaves), *guesses))


def _scaled_noise(planner: MDPOPlanner, factors: Sequence[float]) -> list[ActionNoise] | None:
    """The planner's noise rule, weaker for some restarts."""
    if planner.noise.silent:
        return None
    return [planner.noise.scaled(factor) for factor in factors]
