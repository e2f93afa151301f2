"""What a training and its rollouts begin with: initial values, hyperparameters, parameters."""

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import dtypes, random

from mdpo_rddl.planner.programs.quick import once_jit
from mdpo_rddl.planner.upstream import JaxBackpropPlanner


class Start(NamedTuple):
    """Initial values of a batch of rollouts.

    Attributes:
      fluents: per fluent [B, *shape].
      nonfluents: per non-fluent [*shape].
    """

    fluents: dict[str, Any]
    nonfluents: dict[str, Any]


class InitialValues(NamedTuple):
    """The start of the training rollouts, and of the test rollouts."""

    training: Start
    test: Start


def initial_values(planner: JaxBackpropPlanner) -> InitialValues:
    """Where a planner's rollouts start: in the problem's initial state."""
    training, test = planner._batched_init_subs(planner.test_compiled.init_values)
    return InitialValues(Start(*training), Start(*test))


def repeated(fluents: dict[str, Any], rollouts: int) -> dict[str, np.ndarray]:
    """The initial values of one rollout for so many [N, *shape]; nothing is compiled for it."""
    return {
        name: np.repeat(np.asarray(leaf)[:1], rollouts, axis=0).astype(
            dtypes.canonicalize_dtype(np.asarray(leaf).dtype)
        )
        for name, leaf in fluents.items()
    }


def initial_parameters(planner: JaxBackpropPlanner, key: Any) -> Any:
    """The parameters [R, ...] that JaxPlan's `optimize(key)` begins with, up to rounding.

    Those of one restart do not depend on how many there are.
    """
    keys = random.split(random.split(key)[1], planner.parallel_updates)
    initialize = jax.vmap(planner.plan.initializer, in_axes=(0, None, None))
    # JaxPlan's own program makes the optimiser's state, too, and takes thrice as long to compile
    fluents = initial_values(planner).training.fluents
    return once_jit(initialize)(keys, unit_hyperparams(planner), fluents)


@contextlib.contextmanager
def other_start(planner: JaxBackpropPlanner, stream: int) -> Iterator[None]:
    """Has trainings begin with other parameters than their key says; all else is the key's.

    Args:
      planner: a compiled one.
      stream: of initial parameters; in stream 0 they are JaxPlan's.
    """
    initialize = planner.initialize

    def initialize_in_stream(key: Any, *arguments: Any) -> Any:
        return initialize(random.fold_in(key, stream) if stream else key, *arguments)

    planner.initialize = initialize_in_stream
    try:
        yield
    finally:
        planner.initialize = initialize


def unit_hyperparams(planner: JaxBackpropPlanner) -> dict[str, Any]:
    """JaxPlan's policy hyperparameters where none are given, a preprocessor's among them."""
    return with_preprocessor(planner, dict.fromkeys(planner.rddl.action_fluents, 1.0))


def with_preprocessor(
    planner: JaxBackpropPlanner, hyperparams: Mapping[str, Any]
) -> dict[str, Any]:
    """Policy hyperparameters, with a preprocessor's first values where they lack these."""
    if planner.preprocessor is None:
        return dict(hyperparams)
    return {planner.preprocessor.HYPERPARAMS_KEY: planner.preprocessor.initialize(), **hyperparams}
