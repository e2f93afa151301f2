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

from mdpo_rddl.auto.judge import MeanReturn
from mdpo_rddl.machine.child import end_with, start_python
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.jax_setup import keep_compiled_programs
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import own_config
from mdpo_rddl.planner.planner import MDPOPlanner
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

    def planner(self, problem: Problem) -> MDPOPlanner:
        """A planner that plays it."""
        return build_planner(problem, self.config).planner


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
    built = build_planner(wanted.problem, config)
    compile_guess = time.monotonic() - started + 5.0
    budget = Budget(10**6, max(1.0, _SHARE * wanted.seconds - compile_guess))
    result = train(built, jax.random.PRNGKey(wanted.seed), budget)
    mean, error = MeanReturn(built.planner, _ROLLOUTS, wanted.seed)(result.best_params)
    return Alternative(f"JaxPlan's default {method}", config, result, mean, error)
