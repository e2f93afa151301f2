"""A second process that plays one policy while the first plays another.

It starts when training does, so that it has compiled its policy by the time there is one to
play. Whatever happens to it, the first process can play both.
"""

import contextlib
import logging
import os
import pickle
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any

import jax

from mdpo_rddl.machine.child import start_python
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.jax_setup import leave_out_of_collections
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.preparation import prepare
from mdpo_rddl.session.requests import PlanRequest

logger = logging.getLogger(__name__)

# with fewer steps to play, starting a process takes longer than playing them
_WORTH_STEPS = 1000
_COMMAND = "from mdpo_rddl.session.second_evaluator import serve; serve()"


class SecondEvaluator:
    """Plays parameters in a process of its own, where a core is free for it.

    A context manager: the process ends with the block.
    """

    def __init__(self, request: PlanRequest) -> None:
        """Starts the process if it is worth its while.

        Args:
          request: what is planned and how it is evaluated.
        """
        self._process: subprocess.Popen[bytes] | None = None
        self._threads = ThreadPoolExecutor(1)
        self._evaluation: Future[Evaluation] | None = None
        steps = request.episodes * request.problem.horizon
        # another device than this process's could round otherwise
        is_alike = jax.default_backend() == "cpu"
        if steps < _WORTH_STEPS or usable_cores() < 2 or not is_alike or not sys.executable:
            return
        self._process = start_python(_COMMAND)
        self._threads.submit(self._send, request)

    def __enter__(self) -> "SecondEvaluator":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._threads.shutdown()
        for stream in self._streams():
            with contextlib.suppress(OSError):  # what was not sent is sent to nobody
                stream.close()

    def begin(self, params: Any, policy_hyperparams: Mapping[str, Any]) -> None:
        """Starts to play a policy as the request asks; `result` waits for its end.

        Args:
          params: parameters of one policy, numpy arrays.
          policy_hyperparams: JaxPlan's policy hyperparameters.
        """
        if self._process is not None:
            policy = (params, dict(policy_hyperparams))
            self._evaluation = self._threads.submit(self._play, policy)

    def result(self) -> Evaluation | None:
        """What the policy earned; None if the process was not started or did not manage it."""
        if self._evaluation is None:
            return None
        try:
            return self._evaluation.result()
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            logger.info("the second process gave no result: %r", error)
            return None

    def _streams(self) -> list[Any]:
        return [] if self._process is None else [self._process.stdin, self._process.stdout]

    def _send(self, message: Any) -> None:
        messages, _ = self._streams()
        pickle.dump(message, messages)
        messages.flush()

    def _play(self, policy: tuple[Any, dict[str, Any]]) -> Evaluation:
        self._send(policy)
        _, results = self._streams()
        evaluation = pickle.load(results)
        assert isinstance(evaluation, Evaluation)
        return evaluation


def serve() -> None:
    """The second process: reads a request and a policy, plays it, writes the evaluation."""
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the libraries print is no result
    request = pickle.load(sys.stdin.buffer)
    planner = build_planner(request.problem, request.config).planner
    prepare(planner, request)
    leave_out_of_collections()
    params, hyperparams = pickle.load(sys.stdin.buffer)
    env = make_environment(request.problem)
    policy = playable(planner, params, hyperparams, request.seed)
    pickle.dump(evaluate(env, policy, request.episodes, request.seed), results)
    results.close()
