"""The arm that follows the relaxed model's gradient: MDPO in phases, each from the best so far."""

import dataclasses
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.draws import Draws, key_for
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
# to find what is not finite, while the other arms wait
_REPLAY_SECONDS = 2.0


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


class GradientArm(CompilingArm):
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
        self._training: Training | None = None
        self._parent = arena.incumbent
        self._steps: Sequence[float] = ()
        self._noise: Sequence[float] = ()
        self._best_before = -math.inf
        # phases that are over: the latest is not in `phases` before its first slice
        self._ended = 0

    @property
    def log(self) -> ArmLog:
        """With the recorded iterations of all phases, one after the other."""
        log, done = self._log, 0
        records: list[Record] = []
        for phase in self.phases:
            records += [r._replace(iteration=r.iteration + done) for r in phase.result.history]
            done += phase.result.iterations
        if self.phases:
            log.records, log.iterations = tuple(records), done
            log.sigma = np.concatenate([phase.result.sigma for phase in self.phases])
        log.details = {**log.details, "phases": [self._summary(phase) for phase in self.phases]}
        return log

    def close(self) -> None:
        """Leaves the planner as it was before the training."""
        if self._training is not None:
            self._training.close()

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
        except InputError as error:
            # other arms find a policy without the gradient
            logger.warning("the gradient is of no use: %s", error)
            self.is_exhausted = True

    def _goes_on(self) -> bool:
        """Whether the phase has more to find."""
        found = self._log.best_return
        is_better = found is not None and found > self._best_before
        return is_better and self._training is not None and not self._training.has_ended

    def _begin(self) -> None:
        """Begins a phase; its program is compiled in a thread, for nothing interrupts that."""
        arena, planner, number = self._arena, self._arena.planner, len(self.phases)
        self._parent = best = arena.incumbent
        self.close()
        starts = [best.params] if number else [best.params, arena.constant]
        self._steps, self._noise = self._steps_and_noise(planner)

        guesses = _spread(starts, planner.parallel_updates)
        planner.vary_restarts(learning_rate=self._steps, noise=_scaled_noise(planner, self._noise))
        training = Training(
            Built(planner, arguments={"guess": _stack(guesses), "test_rolling_window": 1}),
            jax.random.fold_in(key_for(Draws.GRADIENT, arena.seed), number),
            Budget(arena.most_iterations, max(_LEAST_SECONDS, arena.deadline - self._clock())),
            arena.tell,
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
        result = training.result(seconds=_REPLAY_SECONDS)
        self._note_not_finite(training, result)
        number = self._ended + 1
        labels = f"phase {number}", f"phase {number}, last iterate"
        self.phases[self._ended :] = [PhaseLog(self._steps, self._noise, result, labels)]
        for label, params in zip(labels, (result.best_params, result.last_params), strict=True):
            self._offer(self._trained(self._parent, label, params, result))
        if result.status == "interrupted":
            raise Cancelled

    def _note_not_finite(self, training: Training, result: TrainingResult) -> None:
        """Counts what is not finite, in the worst phase, and says once where it arises."""
        count, details = result.not_finite + result.lost_sensitivities, self._log.details
        if count and "advice" not in details:
            advice = result.advice or training.diagnosis(seconds=_REPLAY_SECONDS)
            self._log.details = {**details, "advice": advice}
        if count:
            count = max(count, details.get("not_finite", 0))
            self._log.details = {**self._log.details, "not_finite": count}

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
