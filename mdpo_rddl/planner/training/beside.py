"""MDPO in phases, in a process of its own: compiled and trained beside whatever its parent does."""

import os
import threading
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.machine.messages import Messages, packed, unpacked
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.device import fitting_device
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.programs.quick import quick_jit
from mdpo_rddl.planner.training.training import Training, TrainingResult
from mdpo_rddl.planner.update.restarts import PerRestart
from mdpo_rddl.problem.load import Problem

# of the step size after a phase that found nothing better
_SHRINK = 0.3
# the parent's slices end a training, not its own budget
_ITERATIONS, _SECONDS = 10**9, 1e9


class Task(NamedTuple):
    """What a training is made of.

    Attributes:
      problem: the problem.
      config: of the planner, with an optimiser that has a `learning_rate`.
      start: parameters with which it is compiled, whose structure all others have.
      steps: factors of the step size, one for each restart.
      noise: factors of the noise's scale, likewise.
      seed: of everything that is drawn.
      seconds: from now on; a training that is not compiled by then ends.
    """

    problem: Problem
    config: PlannerConfig
    start: Params
    steps: Sequence[float]
    noise: Sequence[float]
    seed: int
    seconds: float


class PhasedTraining:
    """A training that begins anew from whatever it is given, with smaller steps after no success.

    Its first phase has the task's factors. Later ones have them around those of the restart that
    found the best policy of the phase before.
    """

    def __init__(self, task: Task) -> None:
        """Compiles.

        Args:
          task: see there; its seconds are not watched here.

        Raises:
          InputError: if JaxPlan cannot compile the problem.
        """
        self._task = task
        self.planner: MDPOPlanner = build_planner(task.problem, task.config, jit=quick_jit).planner
        self._phase, self._iterations = -1, 0
        self._step = self._noise = 1.0
        self._before = -np.inf
        self._training: Training | None = None
        self._result: TrainingResult | None = None
        self.begin(task.start)

    def begin(self, start: Params) -> None:
        """Begins a phase from a policy.

        Args:
          start: its parameters.
        """
        task, planner, result = self._task, self.planner, self._result
        if self._training is not None:
            self._training.close()
        if result is not None:
            self._iterations += result.iterations
            if result.best_return > self._before:
                self._step *= task.steps[result.restart] / max(task.steps)
                self._before = result.best_return
            else:
                self._step *= _SHRINK
        self._phase, self._result = self._phase + 1, None
        rate = planner.optimizer_kwargs["learning_rate"]
        noise = None if planner.noise.silent else [planner.noise.scaled(f) for f in task.noise]
        steps = [self._step * factor * rate for factor in task.steps]
        planner.vary_restarts(learning_rate=steps, noise=noise)
        guess = PerRestart(jax.tree.map(lambda leaf: jnp.stack([leaf] * planner.restarts), start))
        built = Built(planner, arguments={"guess": guess, "test_rolling_window": 1})
        key = jax.random.fold_in(jax.random.PRNGKey(task.seed), self._phase)
        self._training = Training(built, key, Budget(_ITERATIONS, task.seconds))
        self._training.compile()
        self._training.limit(_SECONDS)

    def advance(self, seconds: float) -> dict[str, Any]:
        """Goes on with the phase.

        Args:
          seconds: how long; one call at least.

        Returns:
          The `params` of its best policy, packed, what they `returned` on the exact model, and the
          `iterations` of all phases.
        """
        assert self._training is not None
        self._training.advance(seconds)
        self._result = result = self._training.result(seconds=0.0)
        return {
            "params": packed(result.best_params),
            "returned": result.best_return,
            "phases": self._phase + 1,
            "iterations": self._iterations + result.iterations,
            "not_finite": result.not_finite + result.lost_sensitivities,
        }


def train_beside(messages: Messages) -> None:
    """Compiles a `Task` and trains in slices, as it is asked to.

    A first answer says that the program is compiled, in how many `compile_seconds`. A question then
    is the `seconds` of a slice, and the packed `start` of a new phase or None. An answer is as of
    `PhasedTraining.advance`, or says an `error`.

    Args:
      messages: to and from the parent.
    """
    task = Task(*unpacked(messages.receive()))
    compiled = threading.Event()

    def give_up() -> None:
        if not compiled.wait(task.seconds):
            os._exit(0)  # nothing else ends what XLA compiles

    threading.Thread(target=give_up, daemon=True).start()
    try:
        with computing_on(fitting_device(task.problem)):
            started = time.monotonic()
            training = PhasedTraining(task)
            compiled.set()
            messages.send({"compile_seconds": time.monotonic() - started})
            while True:
                question = messages.receive()
                if question["start"] is not None:
                    training.begin(unpacked(question["start"]))
                messages.send(training.advance(question["seconds"]))
    except EOFError:
        return
    except InputError as error:
        messages.send({"error": one_line_cause(error)})
