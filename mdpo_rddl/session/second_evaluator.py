"""A second process that plays one policy while the first plays another.

It starts when training does, so that it has compiled its policy by the time there is one to
play. Whatever happens to it, the first process can play both.
"""

import logging
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.child import Child, ChildEndedError, Messages
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.device import is_on_cpu
from mdpo_rddl.machine.jax_setup import kept_tables, leave_out_of_collections
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.file import SavedPolicy, load_parameters, problem_identity, save_policy
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.source import ProblemSource
from mdpo_rddl.session.preparation import prepare
from mdpo_rddl.session.requests import PlanRequest, Terms

logger = logging.getLogger(__name__)

# with fewer steps to play, starting a process takes longer than playing them
_WORTH_STEPS = 1000
_POLICY = "policy.safetensors"


class SecondEvaluator:
    """Plays parameters in a process of its own, where a core is free for it.

    A context manager: the process ends with the block.
    """

    def __init__(self, request: PlanRequest) -> None:
        """Starts the process if it is worth its while.

        Args:
          request: what is planned and how it is evaluated.
        """
        self._request = request
        self._child: Child | None = None
        self._is_asked = False
        steps = request.episodes * request.problem.horizon
        # another device than this process's could round otherwise
        is_alike = is_on_cpu()
        functions = request.problem.functions
        if functions is not None and functions.path is None:
            return  # another process cannot have them
        if steps < _WORTH_STEPS or usable_cores() < 2 or not is_alike or not sys.executable:
            return
        try:
            self._child = Child(serve, on_cpu=True)
        except OSError as error:  # no memory, or too many processes
            logger.info("the second process: %s", error)
            return
        self._ask(
            {
                "problem": asdict(ProblemSource.of(request.problem)),
                "functions": None if functions is None else str(functions.path),
                "config": request.config.to_text(),
                "seed": request.seed,
                "episodes": request.episodes,
            }
        )

    def __enter__(self) -> "SecondEvaluator":
        return self

    def __exit__(self, *error: object) -> None:
        if self._child is not None:
            self._child.end()

    def begin(self, params: Any, policy_hyperparams: Mapping[str, Any]) -> None:
        """Starts to play a policy as the request asks; `result` waits for its end.

        Args:
          params: parameters of one policy, nested dictionaries of arrays.
          policy_hyperparams: JaxPlan's policy hyperparameters.
        """
        if self._child is None:
            return
        request = self._request
        saved = SavedPolicy(
            params=params,
            policy_hyperparams=dict(policy_hyperparams),
            config=request.config.to_text(),
            problem=problem_identity(request.problem),
            seed=request.seed,
        )
        path = self._child.folder / _POLICY
        try:
            save_policy(path, saved)
        except InputError as error:  # a full disk
            logger.info("the second process: %s", error)
            return
        self._ask(str(path))
        self._is_asked = True

    def result(self) -> Evaluation | None:
        """The policy's evaluation; None if the process was not started or did not manage it."""
        if self._child is None or not self._is_asked:
            return None
        try:
            answer = self._child.answer()
        except ChildEndedError as error:
            logger.info("the second process: %s", error)
            return None
        names = "returns", "lengths", "unplayable"
        returns, lengths, unplayable = (np.array(answer.pop(name)) for name in names)
        unmet = tuple(answer.pop("unmet"))
        return Evaluation(returns, lengths, **answer, unplayable=unplayable, unmet=unmet)

    def _ask(self, message: Any) -> None:
        assert self._child is not None
        try:
            self._child.ask(message)
        except ChildEndedError as error:  # then it does not answer either
            logger.info("the second process: %s", error)


def serve(messages: Messages) -> None:
    """The second process: is told a problem, and then a policy, which it plays."""
    asked = messages.receive()
    problem = ProblemSource(**asked["problem"]).load(kept_tables(), asked["functions"])
    config = PlannerConfig.from_text(asked["config"])
    seed, episodes = asked["seed"], asked["episodes"]
    planner = build_planner(problem, config).planner
    prepare(planner, Terms(problem, seed, episodes))
    leave_out_of_collections()
    saved = load_parameters(Path(messages.receive()))
    policy = playable(planner, saved.params, saved.policy_hyperparams, seed)
    found = evaluate(make_environment(problem), policy, episodes, seed)
    messages.send(
        {
            "returns": found.returns.tolist(),
            "lengths": found.lengths.tolist(),
            "illegal_actions": found.illegal_actions,
            "fallback_actions": found.fallback_actions,
            "unplayable": found.unplayable.tolist(),
            "unmet": found.unmet,
        }
    )
