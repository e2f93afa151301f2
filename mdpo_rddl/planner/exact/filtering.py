"""A particle filter on the compiled exact model: what is believed of a hidden state."""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.planner.exact.likelihood import LEAST, ROUNDING, Likelihood
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.start import initial_values

Particles = dict[str, Array]
"""Per state fluent [P, *shape]."""

# a component that is as unlikely as that is one that does not match
_MISMATCH = 0.99 * LEAST


class Filtered(NamedTuple):
    """Particles after an observation, all of the same weight.

    Attributes:
      particles: per state fluent [P, *shape].
      effective: number of particles that the weights were worth before the resampling,
        1 / sum of their squares.
      matches: whether any particle could have led to the observation. Where none could, those that
        differ from it in the fewest components are left.
    """

    particles: Particles
    effective: Array | np.floating
    matches: Array | np.bool_


class ParticleFilter:
    """The bootstrap filter: propagate, weigh by the observation, resample.

    Gordon, Salmond and Smith, "Novel approach to nonlinear/non-Gaussian Bayesian state estimation",
    1993. Reals whose density the model does not give are weighed by a normal kernel, with
    Silverman's bandwidth over the particles' own draws.
    """

    def __init__(self, planner: MDPOPlanner) -> None:
        """Reads the exact model.

        Args:
          planner: of a problem whose state is not observed.
        """
        compiled = planner.test_compiled
        self._compiled, self._rddl = compiled, planner.rddl
        self._likelihood = Likelihood(compiled)
        fluents, self._nonfluents = initial_values(planner).test
        self._fluents = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), fluents)
        self._is_ending = bool(planner.rddl.terminations or planner.rddl.invariants)

    def start(self, count: int) -> Particles:
        """So many particles in the initial state, which is known."""
        return {
            name: jnp.broadcast_to(self._fluents[name], (count, *self._fluents[name].shape))
            for name in self._rddl.state_fluents
        }

    @functools.cached_property
    def advance(self) -> Callable[..., Filtered]:
        """One step of the filter, compiled once for each number of particles.

        A function of a random key, particles, the action that was played and what was observed
        after it, both per fluent [*shape], that gives a `Filtered`.
        """
        transition = self._compiled.compile_transition(check_constraints=self._is_ending)
        model = self._compiled.model_aux["params"]
        likelihood, kernels = self._likelihood, self._likelihood.kernels

        def propagate(key, particle, actions, seen):
            before = {**self._fluents, **actions, **particle}
            after, log, _ = transition(key, actions, before, self._nonfluents, model)
            # the model has put the next state in the state's place
            known, distances = likelihood({**after, **particle}, seen)
            # whoever still observes has seen the episode go on
            ended = log["termination"] | ~log["invariant"]
            known = jnp.append(known, jnp.where(ended, LEAST, 0.0))
            state = {name: jnp.asarray(after[name], particle[name].dtype) for name in particle}
            return state, (known, distances)

        def advance(key, particles, actions, seen):
            count = len(jax.tree.leaves(particles)[0])
            draw_key, resample_key = random.split(key)
            seen = {name: jnp.asarray(seen[name]) for name in self._rddl.observ_fluents}
            keys = random.split(draw_key, count)
            each = jax.vmap(with_fast_random_numbers(propagate), (0, 0, None, None))
            states, (known, distances) = each(keys, particles, self._cast(actions), seen)
            parts = [known, *(kernel(distances[name]) for name in kernels)]
            logs = jnp.concatenate(parts, axis=1)
            weights = jax.nn.softmax(jnp.sum(logs, axis=1))
            places = resampled(resample_key, weights)
            return Filtered(
                jax.tree.map(lambda leaf: leaf[places], states),
                1.0 / jnp.sum(jnp.square(weights)),
                jnp.any(jnp.all(logs > _MISMATCH, axis=1)),
            )

        return jax.jit(advance)

    def _cast(self, actions: Mapping[str, Any]) -> dict[str, Array]:
        return {
            name: jnp.asarray(actions[name], like.dtype).reshape(like.shape)
            for name, like in ((n, self._fluents[n]) for n in self._rddl.action_fluents)
        }


def kernel(distances: Array) -> Array:
    """Log-weights by a normal kernel, at most 0.

    The bandwidth is Silverman's, 1.06 times the standard deviation times P^(-1/5).

    Args:
      distances: of the particles [P, *shape]; one that is not finite weighs least.

    Returns:
      Per component, at least `LEAST` [P, N].
    """
    flat = distances.reshape(len(distances), int(np.prod(distances.shape[1:])))
    known = jnp.where(jnp.isfinite(flat), flat, jnp.nan)
    spread = 1.06 * jnp.nanstd(known, axis=0) * len(flat) ** -0.2
    # where all particles agree
    width = jnp.maximum(spread, ROUNDING * (1.0 + jnp.nanmin(jnp.abs(known), axis=0)))
    logs = jnp.maximum(-0.5 * jnp.square(known / width), LEAST)
    return jnp.where(jnp.isfinite(logs), logs, LEAST)


def resampled(key: Array, weights: Array) -> Array:
    """Systematic resampling: particle i comes P w_i times, rounded up or down.

    Args:
      key: random key.
      weights: that sum to 1 [P].

    Returns:
      The places of P particles, in order [P].
    """
    count = len(weights)
    points = (jnp.arange(count) + random.uniform(key)) / count
    return jnp.clip(jnp.searchsorted(jnp.cumsum(weights), points), 0, count - 1)
