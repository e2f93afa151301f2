"""What an evaluation would begin with, done while the policy is still being trained."""

import contextlib
from collections.abc import Callable, Iterator
from threading import Thread

import jax
import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.requests import EvaluationTerms


def prepare(planner: MDPOPlanner, terms: EvaluationTerms) -> None:
    """Compiles the policy and imports what an evaluation needs.

    Args:
      planner: whose policies will be played.
      terms: how they will be played.
    """
    import scipy.special  # noqa: F401  (the figures of the evaluation need it)

    hyperparams = unit_hyperparams(planner)
    structure = planner.params_structure(hyperparams)
    zeros = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), structure)
    state, _ = make_environment(terms.problem).reset(seed=0)
    playable(planner, zeros, hyperparams, terms.seed)(0, state)


@contextlib.contextmanager
def preparing(planner: MDPOPlanner, terms: EvaluationTerms) -> Iterator[Callable[[], None]]:
    """Prepares in a thread beside training, which leaves Python to others while JAX computes.

    Yields:
      What starts the thread, the first time it is called. It has ended with the block.
    """

    def work() -> None:
        # the evaluation itself will say what is wrong
        with contextlib.suppress(Exception):
            prepare(planner, terms)

    # not inherited from a caller that is a daemon: the end of Python would abort it in XLA
    thread = Thread(target=work, daemon=False)

    def begin() -> None:
        if thread.ident is None:
            thread.start()

    try:
        yield begin
    finally:
        if thread.ident is not None:
            thread.join()
