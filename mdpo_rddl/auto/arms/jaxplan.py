"""JaxPlan's default planners, trained in a second process while the recipe is at work.

They are what a user would have without us; where neither feedback nor its gradient helps, a
straight-line plan or a plain net may still.
"""

import logging
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.auto.judge import MeanReturn
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.child import Child, ChildEndedError, Messages
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.jax_setup import kept_tables
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import own_config
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import Record, TrainingResult, train
from mdpo_rddl.policy.file import SavedPolicy, load_policy, problem_identity, save_policy
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.source import ProblemSource

logger = logging.getLogger(__name__)

METHODS = ("slp", "drp")
_ROLLOUTS = 128
# of the recipe's time, for each of the two: the process must start and compile as well
_SHARE = 0.35
_BEST, _LAST = "best", "last"
# what the answer holds of a training beside its policies
_FIGURES = ("iterations", "best_iteration", "status", "compile_seconds", "train_seconds")


@dataclass(frozen=True)
class ChildRequest:
    """What the second process is asked for, as JSON can hold it.

    Attributes:
      problem: a `ProblemSource`, as a dictionary.
      seed: of training.
      seconds: that the recipe has.
      folder: where the policies go.
    """

    problem: dict[str, Any]
    seed: int
    seconds: float
    folder: str


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
        self._problem = problem
        self._child: Child | None = None
        if not wanted or usable_cores() < 2 or not sys.executable:
            return
        self._child = Child(serve, on_cpu=True)
        source = asdict(ProblemSource.of(problem))
        request = ChildRequest(source, seed, seconds, str(self._child.folder))
        try:
            self._child.ask(asdict(request))
        except ChildEndedError as error:
            logger.info("the second process: %s", error)
            self.stop()

    def __enter__(self) -> "Alternatives":
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

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


def serve(messages: Messages) -> None:
    """The second process: is told what is wanted, trains, and answers for each method."""
    request = ChildRequest(**messages.receive())
    problem = ProblemSource(**request.problem).load(kept_tables())
    for method in METHODS:
        try:
            answer = _train(problem, request, method)
        except Exception as error:  # the other one may do better
            answer = {"cause": " ".join(str(error).split()) or type(error).__name__}
        messages.send({"method": method, **answer})


def _config(method: str) -> PlannerConfig:
    return own_config("default", method).with_section("Noise", {"method": "NoNoise"})


def _file(folder: Path, method: str, which: str) -> Path:
    return folder / f"{method}-{which}.safetensors"


def _train(problem: Problem, request: ChildRequest, method: str) -> dict[str, Any]:
    """Trains, and writes the best and the last policy.

    Raises:
      InputError: if there is no policy with a finite return.
    """
    started = time.monotonic()
    config = _config(method)
    built = build_planner(problem, config)
    compile_guess = time.monotonic() - started + 5.0
    budget = Budget(10**6, max(1.0, _SHARE * request.seconds - compile_guess))
    result = train(built, jax.random.PRNGKey(request.seed), budget)
    mean, error = MeanReturn(built.planner, _ROLLOUTS, request.seed)(result.best_params)
    if not np.isfinite(mean):
        raise InputError("the return is not finite")
    for which, params in ((_BEST, result.best_params), (_LAST, result.last_params)):
        hyperparams = dict(result.policy_hyperparams)
        identity = problem_identity(problem)
        saved = SavedPolicy(params, hyperparams, config.to_text(), identity, request.seed)
        save_policy(_file(Path(request.folder), method, which), saved)
    return {
        "mean": mean,
        "error": error,
        "history": result.history,
        **{name: getattr(result, name) for name in _FIGURES},
    }


def _received(answer: dict[str, Any], folder: Path, problem: Problem) -> Alternative:
    """An answer with its policies.

    Raises:
      InputError: if a file is not a policy of the problem.
    """
    method = answer["method"]
    best, last = (load_policy(_file(folder, method, which)) for which in (_BEST, _LAST))
    if best.problem != problem_identity(problem):
        raise InputError(f"the policy of {method} is one for another problem")
    history = tuple(Record(*record) for record in answer["history"])
    training = TrainingResult(
        best_params=best.params,
        last_params_by_restart=jax.tree.map(lambda leaf: leaf[np.newaxis], last.params),
        policy_hyperparams=best.policy_hyperparams,
        restart=0,
        history=history,
        sigma=np.zeros((len(history), problem.horizon)),  # it was trained without noise
        **{name: answer[name] for name in _FIGURES},
    )
    name = f"JaxPlan's default {method}"
    return Alternative(name, _config(method), training, answer["mean"], answer["error"])
