"""The arm that explores the parameters of a deep reactive policy: PGPE on the exact model."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import CompilingArm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.search.pgpe import Exploring, ParameterExploration
from mdpo_rddl.planner.exact import compile_exact_returns
from mdpo_rddl.planner.start import initial_parameters, unit_hyperparams

PGPE = "pgpe"
_METHOD = "drp"
_ROLLOUTS = 4
# of the deviation after a slice that found nothing better
_NARROWER = 0.5


class ParameterExplorationArm(CompilingArm):
    """Offers the mean of the parameters and the best sample after each slice.

    Only rollouts are compiled, in a thread while other arms work.
    """

    def __init__(self, arena: Arena) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common.
        """
        super().__init__(PGPE, arena)
        self._best_before = -np.inf

    def _begin(self) -> None:
        self._start(self._compile)

    def _work(self, until: float) -> None:
        if not self._is_compiled(until):
            return
        exploration = self._exploration
        stalled = exploration.iterations and exploration.best_return <= self._best_before
        # where all samples return the same, the best is as good as any other
        if stalled and not exploration.is_flat:
            exploration.narrow(_NARROWER)
        self._best_before = exploration.best_return
        exploration.run(self._evaluate, until)
        self._log.iterations = exploration.iterations
        self._estimate = exploration.best_return
        planner = self._arena.plain.built(_METHOD).planner
        if self._may_be_judged(planner, self._params(exploration.best), until):
            for label, vector in (("mean", exploration.mean), ("sample", exploration.best)):
                self._offer(self._candidate(f"pgpe, {label}", vector))

    def _compile(self) -> None:
        """Makes the policy and plays it once."""
        arena = self._arena
        planner = arena.plain.built(_METHOD).planner
        key = jax.random.fold_in(jax.random.PRNGKey(arena.seed), 6)
        params = jax.tree.map(lambda leaf: leaf[0], initial_parameters(planner, key))
        start, self._to_params = ravel_pytree(params)
        self._to_each = jax.jit(jax.vmap(self._to_params))
        rollouts = 1 if arena.probe.deterministic else _ROLLOUTS
        self._returns = compile_exact_returns(planner, rollouts)
        self._key = jax.random.fold_in(key, 1)
        exploring = Exploring(seed=arena.seed)
        self._exploration = ParameterExploration(np.asarray(start), exploring, self._clock)
        self._evaluate(0, np.repeat(np.asarray(start)[np.newaxis], 2 * exploring.pairs, axis=0))

    def _evaluate(self, iteration: int, vectors: np.ndarray) -> np.ndarray:
        """Mean returns [P] of vectors [P, D]."""
        key = jax.random.fold_in(self._key, iteration)
        params = self._to_each(np.asarray(vectors, np.float32))
        return np.mean(np.asarray(self._returns(key, params), float), axis=1)

    def _params(self, vector: np.ndarray) -> Any:
        return jax.tree.map(np.asarray, self._to_params(jnp.asarray(vector, np.float32)))

    def _candidate(self, label: str, vector: np.ndarray) -> Candidate:
        plain = self._arena.plain
        planner = plain.built(_METHOD).planner
        return Candidate(
            arm=self.name,
            label=label,
            config=plain.config(_METHOD),
            planner=planner,
            params=self._params(vector),
            policy_hyperparams=unit_hyperparams(planner),
        )
