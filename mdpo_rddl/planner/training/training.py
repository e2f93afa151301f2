"""Running a planner to the end of its budget and keeping what it found."""

import logging
import math
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import numpy as np

from mdpo_rddl.errors import Cancelled, InputError, note_heard, one_line_cause
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training.checkpoints import (
    LEAST_SECONDS,
    CheckpointedLoop,
    Checkpoints,
    PlainLoop,
)
from mdpo_rddl.planner.training.diagnosis import what_to_try
from mdpo_rddl.planner.training.first_iteration import force_compilation
from mdpo_rddl.planner.training.found import Found, select_restart

logger = logging.getLogger(__name__)


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
      last_params_by_restart: of the last iterate of every restart, each leaf [restarts, ...].
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
      lost_sensitivities: sensitivities of a step that were not finite and counted as zero.
      advice: what went wrong and what to try, in a sentence; None if nothing did.
      best_return: smoothed exact test return of `best_params`, which may not be recorded.
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
    lost_sensitivities: int = 0
    advice: str | None = None
    best_return: float = -math.inf

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
      checkpoints: where its state is left now and then, and with which one it begins.

    Raises:
      InputError: if no restart ever reached a finite test return, or JaxPlan cannot compile
        the problem with the planner's configuration.
    """
    training = Training(built, key, budget, on_progress, checkpoints)
    training.compile()
    if counts_compilation:
        left = training.budget.seconds - training.compile_seconds
        training.limit(max(left, LEAST_SECONDS))
    training.advance()
    return training.result()


class Training:
    """A training that can be stopped and gone on with.

    Attributes:
      budget: where it ends; JaxPlan counts the seconds from the first iteration, pauses included.
      compile_seconds: compilation, with the one iteration that forces it.
      train_seconds: training without compilation and pauses.
      has_ended: whether the budget, the planner's own stopping rule or an interrupt has ended it.
    """

    def __init__(
        self,
        built: Built[MDPOPlanner],
        key: Any,
        budget: Budget | None = None,
        on_progress: Callable[[Progress], None] = lambda progress: None,
        checkpoints: Checkpoints | None = None,
    ) -> None:
        """Compiles nothing yet; the arguments are those of `train`.

        Raises:
          InputError: if a checkpoint does not fit the planner.
        """
        self._built, self._key = built, key
        self.budget, self._on_progress = budget or built.budget, on_progress
        self._loop = _loop(built, self.budget, checkpoints)
        self._resumed = None if checkpoints is None else checkpoints.resumed
        self._earlier_seconds = 0.0 if self._resumed is None else self._resumed.seconds
        self._callbacks: Iterator[dict[str, Any]] | None = None
        self._sizes: tuple[int, int] | None = None
        self._status = "iter_budget_reached"
        self.compile_seconds = self.train_seconds = 0.0
        self.has_ended = self._is_diagnosed = False
        self._advice: str | None = None

    def compile(self) -> None:
        """Compiles an iteration, and bounds the length of a call by the budget's seconds.

        Raises:
          InputError: if JaxPlan cannot compile the problem with the planner's configuration.
        """
        planner, started = self._built.planner, time.perf_counter()
        with planner.call_sizes():  # the calls become shorter only for this training
            force_compilation(self._built, self._key, self.budget)
            if self._resumed is not None and isinstance(self._loop, CheckpointedLoop):
                planner.set_call_sizes(*self._resumed.numbers["call"])
            if planner.in_calls:
                self._sizes = planner.iterations_per_call, planner.test_every
        self.compile_seconds = time.perf_counter() - started

    def limit(self, seconds: float) -> None:
        """Sets the time of the budget; to be called before the first iteration."""
        self.budget = replace(self.budget, seconds=seconds)

    def advance(self, seconds: float = math.inf) -> None:
        """Trains until so many seconds are over or the training has ended; one call at least.

        Raises:
          KeyboardInterrupt: if interrupted before the first iteration, and likewise `Cancelled`.
        """
        started, before = time.perf_counter(), self.train_seconds
        if self._callbacks is None:
            self._callbacks = iter(self._loop.callbacks(self._key, self.budget))
        try:
            with self._built.planner.call_sizes(*(self._sizes or ())):
                while not self.has_ended:
                    callback = self._next(self._callbacks)
                    self.train_seconds = before + time.perf_counter() - started
                    self.has_ended = callback is None
                    if callback is not None:
                        self._add(callback)
                    if time.perf_counter() - started >= seconds:
                        break
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            # the iterates so far are worth keeping
            if not self._loop.found.callback:
                raise
            self._status, self.has_ended = "interrupted", True
            self._loop.save()
        self.train_seconds = before + time.perf_counter() - started

    def close(self) -> None:
        """Ends the loop, whose planner another training may then use."""
        if isinstance(self._callbacks, Generator):
            self._callbacks.close()

    def result(self, **limits: float) -> TrainingResult:
        """What was found so far; at least one iteration must be done.

        Args:
          **limits: the `seconds` of a replay, of what is not finite.

        Raises:
          InputError: if no restart has reached a finite test return.
        """
        found = self._loop.found
        is_over = self.has_ended or not np.isfinite(found.best_return)
        # an arm of a race is asked again and again
        if is_over and not self._is_diagnosed:
            self._advice, self._is_diagnosed = self.diagnosis(**limits), True
            if self._advice is not None:
                logger.warning("%s", self._advice)
        advice = self._advice if is_over else None
        seconds = self.compile_seconds, self.train_seconds + self._earlier_seconds
        return _result(found, self._status, seconds, advice)

    def diagnosis(self, **limits: float) -> str | None:
        """What went wrong so far and what to try; None if nothing did.

        Args:
          **limits: the `seconds` of a replay.
        """
        guess = self._built.arguments.get("guess")
        return what_to_try(self._built.planner, self._loop.found, self._key, guess, **limits)

    def _next(self, callbacks: Iterator[dict[str, Any]]) -> dict[str, Any] | None:
        """The next callback, or None; an `InputError` if a checkpoint turns out not to fit."""
        try:
            return next(callbacks, None)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            if self._resumed is None or self.train_seconds > 0.0:
                raise
            cause = one_line_cause(error)
            raise InputError(f"the checkpoint does not fit the planner: {cause}") from error

    def _add(self, callback: Mapping[str, Any]) -> None:
        found, budget = self._loop.found, self.budget
        found.add(callback)
        self._loop.passed(callback)
        iteration = callback["iteration"]
        seconds = self.train_seconds + self._earlier_seconds
        done = max((iteration + 1) / budget.iterations, seconds / budget.seconds)
        self._on_progress(Progress(min(1.0, done), iteration, found.test_return, found.best_return))
        if callback["status"].is_terminal():
            self._status = callback["status"].name.lower()
            logger.info("training ended after %d iterations: %s", iteration + 1, self._status)


def _loop(
    built: Built[MDPOPlanner], budget: Budget, checkpoints: Checkpoints | None
) -> PlainLoop | CheckpointedLoop:
    """The loop of a training, with the state of an earlier one if there is any.

    Raises:
      InputError: if a checkpoint does not fit the planner.
    """
    if checkpoints is None:
        return PlainLoop(built)
    try:
        if checkpoints.resumed is not None:
            planner = built.planner
            longest = planner.iterations_per_call, planner.test_every
            checkpoints.resumed.require_numbers(budget.iterations, longest)
        return CheckpointedLoop(built, checkpoints)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"the checkpoint does not fit the planner: {error}") from error


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
        raise InputError(
            f"training diverged: the best policy is not finite; {advice or ''}".rstrip("; ")
        )
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
        lost_sensitivities=found.lost_sensitivities,
        advice=advice,
        best_return=float(found.best_return),
    )


def _to_numpy(tree: Any) -> Any:
    return jax.tree.map(np.asarray, tree)
