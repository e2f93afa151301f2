"""How the settings of the arm `greedy` bear on what its policy returns.

    PYTHONPATH=. python tools/value_learning.py ROWS SECONDS SEED PROBLEM:INSTANCE...

For each problem and each of `SETTINGS`, the value learns for SECONDS of the processor's time, from
nothing; then its greedy policy plays `ROLLOUTS` rollouts of the exact model, which are common to
all settings. A row is added to ROWS for each. Compilation is not counted. Other work on the machine
makes it slower but changes little. Run it on one core, with
XLA_FLAGS=--xla_cpu_multi_thread_eigen=false.
"""

import math
import sys
import time
from typing import Any

import jax
import numpy as np
from rows import Rows

from benchmarks.tasks.naming import named_task
from mdpo_rddl.planner.config.fitting import greedy
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.policy_iteration.learner import Learner, Learning, PolicyIteration, Way
from mdpo_rddl.problem.evaluation import mean_and_error

SETTINGS = ((0.9, 48), (0.9, 128), (0.7, 48), (0.7, 128), (0.5, 128))
"""Lambda of the returns, and units of the value's hidden layer."""
ROLLOUTS = 4096
COLUMNS = (
    *("problem", "trace", "units", "seconds", "seed", "iterations", "mean", "error", "commit"),
)
# Adam's step size, and what is left of it in the end, as the arm has them
_STEP, _LAST_STEP = 3e-3, 0.05
_TRIED_SEED = 99


class Experiment:
    """One problem's learner with one pair of settings."""

    def __init__(self, task: str, trace: float, units: int) -> None:
        """Compiles nothing yet."""
        problem = named_task(task).load()
        config = auto_preset(problem.domain_name).without_section("Search")
        shaped = greedy(config).with_policy_arguments(units=units)
        guide = build_planner(problem, config).planner.plan
        self._noop = guide.initializer(jax.random.PRNGKey(0), {}, None)
        planner = build_planner(problem, shaped).planner
        self._iteration = PolicyIteration(planner, guide, Learning(trace=trace))

    def learnt(self, seconds: float, seed: int) -> tuple[Learner, int]:
        """The learner after so many seconds, and its iterations."""
        key = jax.random.PRNGKey(seed)
        begun = self._iteration.begin(np.random.default_rng(seed))
        learner, _ = self._iterated(begun, key, _STEP, is_first=True)
        jax.block_until_ready(learner)
        began, count = time.process_time(), 0
        while (share := (time.process_time() - began) / seconds) < 1.0:
            count += 1
            pace = _STEP * max(_LAST_STEP, 1.0 - share)
            learner, shown = self._iterated(learner, jax.random.fold_in(key, count), pace)
            jax.block_until_ready(shown)
        return learner, count

    def returned(self, learner: Learner) -> tuple[float, float]:
        """The mean return of its policy, and its standard error."""
        count = math.ceil(ROLLOUTS / (self._iteration.rollouts // 2))
        keys = jax.random.split(jax.random.PRNGKey(_TRIED_SEED), count)
        shown = [np.asarray(self._iterated(learner, key, 0.0)[1].returns) for key in keys]
        return mean_and_error(np.concatenate(shown))

    def _iterated(self, learner: Learner, key: Any, pace: float, is_first: bool = False) -> Any:
        way = Way(np.float32(pace), np.array(is_first))
        return self._iteration.iterate(learner, key, self._noop, way)


def main() -> None:
    """Adds the rows."""
    path, seconds, seed, *tasks = sys.argv[1:]
    rows = Rows(path, COLUMNS)
    for task in tasks:
        for trace, units in SETTINGS:
            experiment = Experiment(task, trace, units)
            learner, count = experiment.learnt(float(seconds), int(seed))
            mean, error = experiment.returned(learner)
            numbers = {"mean": f"{mean:.6g}", "error": f"{error:.3g}", "iterations": count}
            given = {"trace": trace, "units": units, "seconds": seconds, "seed": seed}
            rows.add({"problem": task, **given, **numbers})


if __name__ == "__main__":
    main()
