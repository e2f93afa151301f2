"""JaxPlan's default planners, trained in a second process while the recipe is at work.

They are what a user would have without us; where neither feedback nor its gradient helps, a
straight-line plan or a plain net may still.
"""

import contextlib
import logging
import os
import pickle
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NamedTuple

import jax
import numpy as np

from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.judge import MeanReturn
from mdpo_rddl.auto.timing import Clock
from mdpo_rddl.machine.child import end_with, start_python
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.jax_setup import keep_compiled_programs
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import own_config
from mdpo_rddl.planner.training import TrainingResult, train
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

METHODS = ("slp", "drp")
_COMMAND = "from mdpo_rddl.auto.arms.jaxplan import serve; serve()"
_ROLLOUTS = 128
# of the recipe's time, for each of the two: the process must start and compile as well
_SHARE = 0.35


class Wanted(NamedTuple):
    """What the second process is asked for."""

    problem: Problem
    seed: int
    seconds: float


@dataclass(frozen=True)
class Alternative:
    """A policy of one of JaxPlan's default planners.

    Attributes:
      name: for people.
      config: its configuration.
      training: how it was found.
      mean, error: of its return on the exact model.
    """

    name: str
    config: PlannerConfig
    training: TrainingResult
    mean: float
    error: float


class Alternatives:
    """The second process, where a core is free for it; a context manager that ends it."""

    def __init__(self, problem: Problem, seed: int, seconds: float, wanted: bool) -> None:
        """Starts the process.

        Args:
          problem: the parsed problem.
          seed: of training.
          seconds: that the recipe has.
          wanted: whether to start it at all.
        """
        self._threads = ThreadPoolExecutor(1)
        self._process: Any = None
        self._found: Future[list[Alternative]] | None = None
        if not wanted or usable_cores() < 2 or not sys.executable:
            return
        self._process = start_python(_COMMAND)
        self._found = self._threads.submit(self._ask, Wanted(problem, seed, seconds))

    def __enter__(self) -> "Alternatives":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()
        self._threads.shutdown()
        if self._process is not None:
            for stream in (self._process.stdin, self._process.stdout):
                with contextlib.suppress(OSError):
                    stream.close()

    @property
    def started(self) -> bool:
        """Whether there is such a process, at work or done."""
        return self._process is not None

    def stop(self) -> None:
        """Ends the process; there is no alternative then."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def best(self, until: float) -> Alternative | None:
        """The best that was found in time; None if there is none.

        Args:
          until: how long to wait, by `time.monotonic`.
        """
        if self._found is None:
            return None
        try:
            found = self._found.result(timeout=max(0.0, until - time.monotonic()))
        except (TimeoutError, OSError, EOFError, pickle.UnpicklingError) as error:
            logger.info("the second process gave no result: %r", error)
            return None
        return max(found, key=lambda one: one.mean, default=None)

    def _ask(self, wanted: Wanted) -> list[Alternative]:
        pickle.dump(wanted, self._process.stdin)
        self._process.stdin.flush()
        found = pickle.load(self._process.stdout)
        assert isinstance(found, list)
        return found


class JaxPlanArm(Arm):
    """Offers the best policy of JaxPlan's default planners, once they have been trained."""

    def __init__(self, alternatives: Alternatives, clock: Clock) -> None:
        """The second process is at work already.

        Args:
          alternatives: the second process.
          clock: what `until` of a slice is by.
        """
        super().__init__("JaxPlan", clock)
        self._alternatives = alternatives

    def _work(self, until: float) -> None:
        best = self._alternatives.best(time.monotonic() + until - self._clock())
        if best is None:
            return
        training = best.training
        self._log.iterations += training.iterations
        # beside the other arms: none of the race's own time
        self._log.seconds += training.train_seconds + training.compile_seconds
        self._offer(
            Candidate(
                arm=self.name,
                label=best.name,
                config=best.config,
                planner=None,
                params=training.best_params,
                policy_hyperparams=dict(training.policy_hyperparams),
                mean=best.mean,
                error=best.error,
            )
        )


def serve() -> None:
    """The second process: reads what is wanted, trains, writes the alternatives."""
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the libraries print is no result
    threading.Thread(target=end_with, args=(os.getppid(),), daemon=True).start()
    wanted: Wanted = pickle.load(sys.stdin.buffer)
    keep_compiled_programs()
    found = []
    for method in METHODS:
        try:
            found.append(_train(wanted, method))
        except Exception as error:  # the other one may do better
            logger.info("%s: %s", method, error)
    pickle.dump([one for one in found if np.isfinite(one.mean)], results)
    results.close()


def _train(wanted: Wanted, method: str) -> Alternative:
    started = time.monotonic()
    config = own_config("default", method).with_section("Noise", {"method": "NoNoise"})
    planner, optimize_args = build_planner(wanted.problem, config)
    for name in ("key", "epochs", "train_seconds"):
        optimize_args.pop(name, None)
    compile_guess = time.monotonic() - started + 5.0
    result = train(
        planner,
        key=jax.random.PRNGKey(wanted.seed),
        iterations=10**6,
        seconds=max(1.0, _SHARE * wanted.seconds - compile_guess),
        optimize_kwargs=optimize_args,
    )
    mean, error = MeanReturn(planner, _ROLLOUTS, wanted.seed)(result.best_params)
    return Alternative(f"JaxPlan's default {method}", config, result, mean, error)
