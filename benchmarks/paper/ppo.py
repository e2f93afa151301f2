"""The paper's model-free baseline: PPO on the exact model, with the same policy net."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import jax
from jax import random

from benchmarks.paper.exact_steps import compile_exact_steps
from benchmarks.paper.iterates import Iterate, timed
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.start import initial_parameters
from mdpo_rddl.planner.training.training import select_restart
from mdpo_rddl.planner.update.sharding import restart_sharding, shard
from mdpo_rddl.problem.load import Problem

EPOCHS = 10
"""Updates after each rollout, as in the paper."""
# tfp-nightly and tensorflow-probability, which JaxPlan brings, write to the same place
_INSTALL = "pip install 'mdpo-rddl[paper]' && pip install --force-reinstall --no-deps tfp-nightly"
# the other methods use the key itself
_STREAM = 0x70706F


def train_ppo(
    problem: Problem, config: PlannerConfig, key: Any, iterations: Sequence[int]
) -> Iterator[Iterate]:
    """Trains all seeds side by side; an iteration is one rollout and `EPOCHS` updates on it.

    Net, initial weights and discount are the other methods'; the critic is of the same size, and
    all else, the optimiser too, is rejax's default.

    Args:
      problem: the setting.
      config: the net; the seeds are its parallel updates.
      key: JAX random key; as the other methods have it.
      iterations: which iterates are wanted, in order.

    Raises:
      InputError: if rejax cannot be imported.
    """
    try:
        from benchmarks.paper.ppo_learner import first_state, make_learner
    except (ImportError, AttributeError) as error:  # the latter from tensorflow-probability 0.25
        raise InputError(f"ppo cannot be imported: {error}; to get it: {_INSTALL}") from error
    planner = build_planner(problem, config).planner
    seeds, nets = planner.parallel_updates, initial_parameters(planner, key)
    units = tuple(config.policy_arguments["topology"])
    steps = compile_exact_steps(planner)
    learner = make_learner(steps, select_restart(nets, 0), units, EPOCHS)

    @jax.jit
    @partial(jax.vmap, in_axes=(0, None))
    def train(state, count):
        return jax.lax.fori_loop(0, count, lambda _, s: learner.train_iteration(s), state)

    keys = random.split(random.fold_in(key, _STREAM), seeds)
    start = jax.jit(jax.vmap(partial(first_state, learner)))
    states = shard(start(keys, nets), restart_sharding(seeds))
    states = jax.block_until_ready(train(states, 0))  # compiles, and settles the types
    done = 0

    def advance(until: int) -> tuple[Any, None]:
        nonlocal states, done
        states, done = train(states, until - done), until
        return states.actor_ts.params["net"], None

    return timed(advance, iterations)
