"""What random actions return, as plans of policies that do nothing else."""

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from mdpo_rddl.planner.plans.feedback import Params

_PLANS = 16


def random_plans(noop: Params, boxes: Mapping[str, np.ndarray], seed: int) -> Iterator[Params]:
    """Policies whose actions are drawn uniformly from their boxes, at every step anew.

    Args:
      noop: parameters of a policy with a plan that plays the no-op.
      boxes: per action fluent the ends of its raw action [2, *shape].
      seed: of the actions.
    """
    random = np.random.default_rng([seed, 3])
    for _ in range(_PLANS):
        plan = {
            name: random.uniform(lower, upper, np.shape(noop["plan"][name])).astype(np.float32)
            for name, (lower, upper) in boxes.items()
        }
        yield {**noop, "plan": plan}


def mean_until(returns: Iterable[np.ndarray], is_over: Callable[[], bool]) -> float:
    """The mean of arrays, of the first one at least, until it is over."""
    means = []
    for each in returns:
        means.append(float(np.mean(each)))
        if is_over():
            break
    return float(np.mean(means))
