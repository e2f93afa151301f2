"""Running a planner to the end of its budget and keeping what it found."""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import numpy as np

from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.checkpoints import CheckpointedLoop, Checkpoints
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.diagnosis import what_to_try
from mdpo_rddl.planner.found import Found, select_restart
from mdpo_rddl.planner.missing import missing_package
from mdpo_rddl.planner.planner import MDPOPlanner

logger = logging.getLogger(__name__)

# a budget has at least so many calls, for a bound on the time can then be kept and a learning
# curve needs points
_CALLS_IN_A_BUDGET = 20
_CALLS_IN_A_RUN = 60
# whoever waits wants to see something move
_CALL_SECONDS = 1.0
# what is left of a time that compilation has used up: one call
_LEAST_SECONDS = 1e-3


class Record(NamedTuple):
    """One recorded iteration of the restart that found the best iterate.

    Attributes:
      iteration: counted from 0.
      train_return: utility of the relaxed, perturbed rollouts.
      test_return: exact, noise-free return, averaged over JaxPlan's rolling window.
      mean_sigma: the noise's scale averaged over the horizon.
    """

    iteration: int
    train_return: float
    test_return: float
    mean_sigma: float


class Progress(NamedTuple):
    """What is worth showing while training goes on: the budget used and the returns."""

    fraction: float
    iteration: int
    test_return: float
    best_return: float


@dataclass(frozen=True)
class TrainingResult:
    """What a training run found.

    Attributes:
      best_params: parameters of the iterate with the best smoothed exact test return.
      last_params_by_restart: parameters of the last iterate of every restart, with a
        leading axis [restarts, ...].
      policy_hyperparams: JaxPlan's policy hyperparameters that go with them.
      iterations: iterations done.
      best_iteration: iteration of `best_params`.
      restart: the restart that `best_params` come from; the records are of it.
      status: JaxPlan's status at the end, in lower case, or "interrupted".
      history: the recorded iterations.
      sigma: the noise's scale per recorded iteration and step [recorded, H].
      compile_seconds: compilation, with the one iteration that forces it.
      train_seconds: training without compilation.
      not_finite: training and test returns that were not finite numbers.
      advice: what went wrong and what to try, in a sentence; None if nothing did.
    """

    best_params: Any
    last_params_by_restart: Any
    policy_hyperparams: Mapping[str, Any]
    iterations: int
    best_iteration: int
    restart: int
    status: str
    history: tuple[Record, ...]
    sigma: np.ndarray
    compile_seconds: float
    train_seconds: float
    not_finite: int = 0
    advice: str | None = None

    @property
    def last_params(self) -> Any:
        """Parameters of the last iterate of the restart that found the best one."""
        return select_restart(self.last_params_by_restart, self.restart)


def train(
    built: Built[MDPOPlanner],
    key: Any,
    budget: Budget | None = None,
    *,
    counts_compilation: bool = False,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    checkpoints: Checkpoints | None = None,
) -> TrainingResult:
    """Trains until the iterations, the seconds or the planner's own stopping rule end it.

    A keyboard interrupt or `Cancelled` after the first iteration ends it likewise, with what was
    found.

    Args:
      built: the compiled planner; all its parallel updates are restarts of one search.
      key: JAX random key.
      budget: largest number of iterations, at least 1, and largest time; as configured if None.
      counts_compilation: whether compilation is part of that time.
      on_progress: called after each iteration.
      checkpoints: where its state is left now and then, and with which one it begins; without
        effect for planners whose state cannot be seen.

    Raises:
      InputError: if no restart ever reached a finite test return, or JaxPlan cannot compile
        the problem with the planner's configuration.
    """
    planner, budget = built.planner, budget or built.budget
    with planner.call_sizes():  # the calls become shorter only for this training
        started = time.perf_counter()
        _force_compilation(built, key, budget)
        compile_seconds = time.perf_counter() - started
        if counts_compilation:
            left = max(budget.seconds - compile_seconds, _LEAST_SECONDS)
            budget = replace(budget, seconds=left)
        started = time.perf_counter()
        found, status = _run(_loop(built, checkpoints), key, budget, on_progress)
        train_seconds = time.perf_counter() - started
        if checkpoints is not None and checkpoints.resumed is not None:
            train_seconds += checkpoints.resumed.seconds
    return _result(
        found, status, (compile_seconds, train_seconds), what_to_try(planner, found, key)
    )


class _Loop:
    """The callbacks of a training without checkpoints."""

    def __init__(self, built: Built[MDPOPlanner]) -> None:
        self.found = Found(built.planner.in_calls)
        self.callbacks = built.callbacks

    def passed(self, callback: Mapping[str, Any]) -> None:
        """Keeps nothing."""

    def save(self) -> None:
        """Keeps nothing."""


def _loop(built: Built[MDPOPlanner], checkpoints: Checkpoints | None) -> _Loop | CheckpointedLoop:
    """The loop of a training, with the sizes of a call that an earlier one had.

    Raises:
      InputError: if a checkpoint does not fit the planner.
    """
    if checkpoints is None or not CheckpointedLoop.is_possible(built.planner):
        return _Loop(built)
    try:
        loop = CheckpointedLoop(built, checkpoints)
        if checkpoints.resumed is not None:
            built.planner.set_call_sizes(*map(int, checkpoints.resumed.numbers["call"]))
    except (LookupError, TypeError, ValueError) as error:
        raise InputError(f"the checkpoint does not fit the planner: {error}") from error
    return loop


def _run(
    loop: _Loop | CheckpointedLoop,
    key: Any,
    budget: Budget,
    on_progress: Callable[[Progress], None],
) -> tuple[Found, str]:
    """What the iterations have found, and why they ended."""
    started = time.perf_counter()
    found = loop.found
    status = "iter_budget_reached"
    try:
        for callback in loop.callbacks(key, budget):
            found.add(callback)
            loop.passed(callback)
            iteration, elapsed = callback["iteration"], time.perf_counter() - started
            done = max((iteration + 1) / budget.iterations, elapsed / budget.seconds)
            on_progress(Progress(min(1.0, done), iteration, found.test_return, found.best_return))
            if callback["status"].is_terminal():
                status = callback["status"].name.lower()
    except (KeyboardInterrupt, Cancelled):
        # the iterates so far are worth keeping
        if not found.callback:
            raise
        status = "interrupted"
        loop.save()
    return found, status


def _force_compilation(built: Built[MDPOPlanner], key: Any, budget: Budget) -> None:
    """Compiles the update and the test, and sees to it that a call does not take too long."""
    planner = built.planner
    # no recompilation for another size, and no dashboard of its own
    generator = built.with_arguments(dashboard_id=None).callbacks(key, budget)
    with planner.call_sizes(1, 1):
        try:
            next(generator)
            started = time.perf_counter()
            if planner.in_calls:
                next(generator, None)
        except Exception as error:  # whatever the problem and the values make JAX raise
            kind_and_message = " ".join(f"{type(error).__name__}: {error}".split())
            cause = missing_package(error) or kind_and_message
            raise InputError(f"JaxPlan cannot compile the planner: {cause}") from error
    generator.close()
    if planner.in_calls:
        seconds = time.perf_counter() - started
        longest = budget.seconds / _CALLS_IN_A_BUDGET
        planner.bound_calls(min(longest / seconds, budget.iterations / _CALLS_IN_A_RUN))
        # tests as often as on a faster machine, or the best iterate would be another one
        planner.bound_calls(max(_CALL_SECONDS / seconds, planner.test_every))


def _result(
    found: Found, status: str, seconds: tuple[float, float], advice: str | None
) -> TrainingResult:
    callback, kept, restart = found.callback, found.kept, found.best_restart
    if not np.isfinite(found.best_return):
        raise InputError(
            f"training diverged: no finite return in {callback['iteration'] + 1} iterations; "
            f"{advice}"
        )
    best = _to_numpy(found.best_params)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(best)):
        raise InputError(f"training diverged: the best policy is not finite; {advice}")
    if advice is not None:
        logger.warning("%s", advice)
    logger.info("training ended after %d iterations: %s", callback["iteration"] + 1, status)
    history = tuple(
        Record(
            iteration=entry["iteration"],
            train_return=float(entry["train_return"][restart]),
            test_return=float(entry["test_return"][restart]),
            mean_sigma=float(np.mean(entry["sigma"][restart])),
        )
        for entry in kept
    )
    return TrainingResult(
        best_params=best,
        last_params_by_restart=_to_numpy(callback["params"]),
        policy_hyperparams=_to_numpy(dict(callback["policy_hyperparams"])),
        iterations=callback["iteration"] + 1,
        best_iteration=found.best_iteration,
        restart=restart,
        status=status,
        history=history,
        sigma=np.stack([np.asarray(entry["sigma"][restart]) for entry in kept]),
        compile_seconds=seconds[0],
        train_seconds=seconds[1],
        not_finite=found.not_finite,
        advice=advice,
    )


def _to_numpy(tree: Any) -> Any:
    return jax.tree.map(np.asarray, tree)
