"""The part of the recipe that follows the gradient: MDPO in phases, each from the best so far."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.judge import Choice
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.machine.background import Work
from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.training import Progress, Record, TrainingResult, train
from mdpo_rddl.planner.update.restarts import PerRestart

logger = logging.getLogger(__name__)

_PHASES = 3
# of the optimiser's learning rate
_FIRST_STEPS = (0.3, 1.0, 1.0, 3.0)
_FIRST_NOISE = (0.3, 0.3, 1.0, 1.0)
_LATER_STEPS = (1.0, 0.3)
# of the step size after a phase that found nothing better
_SHRINK = 0.3
# of the time left: the first phase compiles the program of all
_FIRST_SHARE = 0.5
_SHORTEST_SECONDS = 0.5
_ITERATIONS = 10**6


@dataclass
class Descent:
    """What the phases did.

    Attributes:
      steps: each phase's step sizes, one for each restart.
      results: each phase's training.
      improved: whether each phase found a better policy.
    """

    steps: list[list[float]] = field(default_factory=list)
    results: list[TrainingResult] = field(default_factory=list)
    improved: list[bool] = field(default_factory=list)

    def summary(self) -> list[dict[str, Any]]:
        """A line for each phase, as JSON can hold it."""
        return [
            {
                "iterations": result.iterations,
                "step": steps[result.restart],
                "seconds": round(result.train_seconds, 2),
                "improved": improved,
            }
            for steps, result, improved in zip(self.steps, self.results, self.improved, strict=True)
        ]

    def result(self, best: Params, last: Params, horizon: int, seconds: float) -> TrainingResult:
        """All phases as one training that found `best`.

        Args:
          best: the chosen parameters.
          last: the recipe's last ones.
          horizon: number of steps H.
          seconds: that everything took.
        """
        best = jax.tree.map(np.asarray, best)
        one = jax.tree.map(lambda leaf: np.asarray(leaf)[np.newaxis], last)
        if not self.results:
            nothing = (Record(0, float("nan"), float("nan"), 0.0),)
            return TrainingResult(
                best, one, {}, 0, 0, 0, "no_gradient", nothing, np.zeros((1, horizon)), 0.0, seconds
            )
        history: list[Record] = []
        done, best_iteration = 0, 0
        for result, improved in zip(self.results, self.improved, strict=True):
            history += [r._replace(iteration=r.iteration + done) for r in result.history]
            best_iteration = done + result.best_iteration if improved else best_iteration
            done += result.iterations
        return TrainingResult(
            best_params=best,
            last_params_by_restart=one,
            policy_hyperparams=self.results[-1].policy_hyperparams,
            iterations=done,
            best_iteration=best_iteration,
            restart=0,
            status=self.results[-1].status,
            history=tuple(history),
            sigma=np.concatenate([result.sigma for result in self.results]),
            compile_seconds=sum(result.compile_seconds for result in self.results),
            train_seconds=seconds,
        )


def descend(
    planner: MDPOPlanner,
    descent: Descent,
    starts: Sequence[Params],
    choice: Choice,
    *,
    key: Any,
    deadline: float,
    work: Work,
    on_progress: Callable[[Progress], None],
) -> None:
    """Trains in phases.

    The first goes from all starts, with several step sizes each; the later ones from the best
    policy so far, with the step size that found it and a smaller one.

    Args:
      planner: compiled, with several parallel updates and an optimiser with a `learning_rate`.
      descent: takes note of each phase as it ends.
      starts: parameters of single policies.
      choice: is told of each phase's best and last iterate.
      key: JAX random key.
      deadline: when to end, by `time.monotonic`; compilation counts.
      work: asked after each call; once it is abandoned nothing is told any more.
      on_progress: called while training goes on.

    Raises:
      Cancelled: if cancelled, with what was found till then in `choice`.
    """
    count = planner.parallel_updates
    guesses = [starts[number * len(starts) // count] for number in range(count)]
    rate = planner.optimizer_kwargs["learning_rate"]
    steps = [rate * factor for factor in _repeated(_FIRST_STEPS, count)]
    noise = _repeated(_FIRST_NOISE, count)

    def tell(progress: Progress) -> None:
        work.raise_if_cancelled()
        on_progress(progress)

    for phase in range(_PHASES):
        left = deadline - time.monotonic()
        seconds = left / (_PHASES - phase) if phase else _FIRST_SHARE * left
        if seconds < _SHORTEST_SECONDS:
            break
        planner.vary_restarts(learning_rate=steps, noise=_scaled_noise(planner, noise))
        try:
            result = train(
                Built(planner, arguments={"guess": _stack(guesses), "test_rolling_window": 1}),
                jax.random.fold_in(key, phase),
                Budget(_ITERATIONS, seconds),
                counts_compilation=True,
                on_progress=tell,
            )
        except InputError as error:
            # the search has found a policy without the gradient
            logger.warning("the gradient is of no use: %s", error)
            break
        if work.is_abandoned:
            return
        better = choice.add(f"phase {phase + 1}", result.best_params)
        better |= choice.add(f"phase {phase + 1}, last iterate", result.last_params)
        descent.steps.append(steps)
        descent.results.append(result)
        descent.improved.append(better)
        if result.status == "interrupted":
            raise Cancelled
        step = steps[result.restart] if better else max(steps) * _SHRINK
        guesses = [choice.best] * count
        noise = [(noise[result.restart] if better else max(noise)) * _SHRINK] * count
        steps = [step * factor for factor in _repeated(_LATER_STEPS, count)]


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
