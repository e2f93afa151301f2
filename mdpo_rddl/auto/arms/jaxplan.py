"""JaxPlan's default planners, trained in a second process while the race goes on.

They are what a user would have without us; where neither feedback nor its gradient helps, a
straight-line plan or a plain net may still.
"""

import logging
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.auto.arena.judge import MeanReturn, rollouts_for
from mdpo_rddl.auto.arena.plain import METHODS
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.child import Child, ChildEndedError, Messages
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.jax_setup import kept_tables
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.planner.training.training import train
from mdpo_rddl.policy.file import SavedPolicy, load_parameters, problem_identity, save_policy
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.source import ProblemSource

logger = logging.getLogger(__name__)

# of the race's time, for each of the two: the process must start and compile as well
_SHARE = 0.35


@dataclass(frozen=True)
class ChildRequest:
    """What the second process is asked for, as JSON can hold it.

    Attributes:
      problem: a `ProblemSource`, as a dictionary.
      seed: of training.
      seconds: that the race has.
      folder: where the policies go.
      raises: whether the environment was seen to raise an error in play.
      functions: the file of the Python functions that the domain calls, if it calls any.
    """

    problem: dict[str, Any]
    seed: int
    seconds: float
    folder: str
    raises: bool = False
    functions: str | None = None


@dataclass(frozen=True)
class Alternative:
    """A policy of one of JaxPlan's default planners.

    Attributes:
      name: for people.
      config: its configuration.
      params, policy_hyperparams: of the policy.
      iterations: of its training.
      seconds: that its training took, compilation included.
      mean, error: of its return on the exact model.
    """

    name: str
    config: PlannerConfig
    params: Any
    policy_hyperparams: Mapping[str, Any]
    iterations: int
    seconds: float
    mean: float
    error: float


class Alternatives:
    """The second process, where a core is free for it; a context manager that ends it."""

    def __init__(self, problem: Problem, seed: int, seconds: float, wanted: bool) -> None:
        """Starts nothing yet.

        Args:
          problem: the parsed problem.
          seed: of training.
          seconds: that the race has.
          wanted: whether to start it at all.
        """
        self._problem, self._seed, self._seconds, self._wanted = problem, seed, seconds, wanted
        self._child: Child | None = None

    def __enter__(self) -> "Alternatives":
        """Starts the process."""
        functions = self._problem.functions
        # functions from no file stay in this process
        is_told = functions is None or functions.path is not None
        if is_told and self._wanted and usable_cores() > 1 and sys.executable:
            self._start()
        return self

    def _start(self) -> None:
        try:
            self._child = Child(serve, on_cpu=True)
        except OSError as error:  # no memory, or too many processes
            logger.info("the second process: %s", error)
            return
        source = asdict(ProblemSource.of(self._problem))
        folder, raises = str(self._child.folder), self._problem.raises
        functions = self._problem.functions
        path = None if functions is None else str(functions.path)
        request = ChildRequest(source, self._seed, self._seconds, folder, raises, path)
        try:
            self._child.ask(asdict(request))
        except ChildEndedError as error:
            logger.info("the second process: %s", error)
            self.stop()
        except BaseException:  # `with` does not end what was not entered
            self.stop()
            raise

    def __exit__(self, *error: object) -> None:
        self.stop()

    @property
    def started(self) -> bool:
        """Whether there is such a process, at work or done."""
        return self._child is not None

    def stop(self) -> None:
        """Ends the process; there is no alternative then."""
        if self._child is not None:
            self._child.end()
            self._child = None

    def best(self, until: float) -> Alternative | None:
        """The best that was found in time; None if there is none.

        Args:
          until: how long to wait, by `time.monotonic`.
        """
        if self._child is None:
            return None
        ready = []
        try:
            for _ in METHODS:
                answer = self._child.answer(max(0.0, until - time.monotonic()))
                if "cause" in answer:
                    logger.info("%s: %s", answer["method"], answer["cause"])
                else:
                    ready.append(_received(answer, self._child.folder, self._problem))
        except TimeoutError:
            logger.info("the second process is late")
        except (ChildEndedError, InputError) as error:
            logger.info("the second process: %s", error)
        return max(ready, key=lambda one: one.mean, default=None)


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
        self._log.iterations += best.iterations
        # beside the other arms: none of the race's own time
        self._log.seconds += best.seconds
        self._offer(
            Candidate(
                arm=self.name,
                label=best.name,
                config=best.config,
                planner=None,
                params=best.params,
                policy_hyperparams=dict(best.policy_hyperparams),
                mean=best.mean,
                error=best.error,
            )
        )


def serve(messages: Messages) -> None:
    """The second process: is told what is wanted, trains, and answers for each method."""
    request = ChildRequest(**messages.receive())
    problem = ProblemSource(**request.problem).load(kept_tables(), request.functions)
    problem = replace(problem, raises=request.raises)
    for method in METHODS:
        try:
            answer = _train(problem, request, method)
        except Exception as error:  # the other one may do better
            answer = {"cause": " ".join(str(error).split()) or type(error).__name__}
        messages.send({"method": method, **answer})


def _config(method: str) -> PlannerConfig:
    return jaxplan_config("default", method).without_noise()


def _file(folder: Path, method: str) -> Path:
    return folder / f"{method}.safetensors"


def _train(problem: Problem, request: ChildRequest, method: str) -> dict[str, Any]:
    """Trains, and writes the best policy.

    Raises:
      InputError: if there is no policy with a finite return.
    """
    started = time.monotonic()
    config = _config(method)
    built = build_planner(problem, config)
    compile_guess = time.monotonic() - started + 5.0
    budget = Budget(10**6, max(1.0, _SHARE * request.seconds - compile_guess))
    result = train(built, jax.random.PRNGKey(request.seed), budget)
    mean, error = MeanReturn(built.planner, rollouts_for(problem), request.seed)(result.best_params)
    if not np.isfinite(mean):
        raise InputError("the return is not finite")
    hyperparams, identity = dict(result.policy_hyperparams), problem_identity(problem)
    saved = SavedPolicy(result.best_params, hyperparams, config.to_text(), identity, request.seed)
    save_policy(_file(Path(request.folder), method), saved)
    seconds = time.monotonic() - started
    return {"mean": mean, "error": error, "iterations": result.iterations, "seconds": seconds}


def _received(answer: dict[str, Any], folder: Path, problem: Problem) -> Alternative:
    """An answer with its policy.

    Raises:
      InputError: if the file is not a policy of the problem.
    """
    method = answer["method"]
    saved = load_parameters(_file(folder, method))
    if saved.problem != problem_identity(problem):
        raise InputError(f"the policy of {method} is one for another problem")
    return Alternative(
        name=f"JaxPlan's default {method}",
        config=_config(method),
        params=saved.params,
        policy_hyperparams=saved.policy_hyperparams,
        iterations=answer["iterations"],
        seconds=answer["seconds"],
        mean=answer["mean"],
        error=answer["error"],
    )
