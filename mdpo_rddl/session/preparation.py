"""What an evaluation would begin with, done while the policy is still being trained."""

import contextlib
from threading import Thread
from types import TracebackType

import jax
import numpy as np

from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.planning import playable
from mdpo_rddl.problem import make_environment
from mdpo_rddl.session.requests import PlanRequest


def prepare(planner: MDPOPlanner, request: PlanRequest) -> None:
    """Compiles the policy and imports what an evaluation needs.

    Args:
      planner: whose policies will be played.
      request: how they will be played.
    """
    import scipy.special  # noqa: F401  (the figures of the evaluation need it)

    hyperparams = dict.fromkeys(planner.rddl.action_fluents, 1.0)
    structure = planner.params_structure(hyperparams)
    zeros = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), structure)
    state, _ = make_environment(request.problem).reset(seed=0)
    playable(planner, zeros, hyperparams, request.seed)(0, state)


class Preparation:
    """Prepares in a thread beside training, which leaves Python to others while JAX computes.

    A context manager: the thread has ended with the block.
    """

    def __init__(self, planner: MDPOPlanner, request: PlanRequest) -> None:
        """Does nothing yet; the arguments are those of `prepare`."""
        self._thread = Thread(target=self._prepare, args=(planner, request))
        self._has_begun = False

    def __enter__(self) -> "Preparation":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._has_begun:
            self._thread.join()

    def begin(self) -> None:
        """Starts the thread, the first time."""
        if not self._has_begun:
            self._has_begun = True
            self._thread.start()

    @staticmethod
    def _prepare(planner: MDPOPlanner, request: PlanRequest) -> None:
        # the evaluation itself will say what is wrong
        with contextlib.suppress(Exception):
            prepare(planner, request)
