"""What random actions return, as plans of policies that do nothing else."""

from collections.abc import Mapping

import jax
import numpy as np

from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.planner.plans.feedback import Params


def random_return(
    population: PopulationReturns,
    noop: Params,
    boxes: Mapping[str, np.ndarray],
    seed: int,
) -> float:
    """Mean return of actions drawn uniformly from their boxes, at every step anew.

    Args:
      population: plays them.
      noop: parameters of a policy with a plan that plays the no-op.
      boxes: per action fluent the ends of its raw action [2, *shape].
      seed: of the actions.
    """
    count = population.population
    random = np.random.default_rng([seed, 3])
    plan = {}
    for name, (lower, upper) in boxes.items():
        size = (count, *np.shape(noop["plan"][name]))
        plan[name] = random.uniform(lower, upper, size).astype(np.float32)
    each = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (count, *np.shape(leaf))), noop)
    return float(np.mean(population.returns({**each, "plan": plan})))
