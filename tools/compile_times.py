"""How long a gradient takes to compile, beside the judge's rollouts, by which that is foretold.

    PYTHONPATH=. python tools/compile_times.py ROWS PROBLEM:INSTANCE...

For each problem the judge's program (128 rollouts of one feedback policy), and the training of
that policy as races of up to three minutes have it, are traced and compiled, one after the other,
without JAX's cache; times are by the clock, in seconds. Rows are added to ROWS. Run it on one core,
with nothing beside it.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from rows import Rows

from benchmarks.tasks.naming import named_task
from mdpo_rddl.auto.arena.judge import ROLLOUTS
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.programs.quick import quick_jit
from mdpo_rddl.planner.training.training import Training
from mdpo_rddl.planner.update.restarts import PerRestart

COLUMNS = ("problem", "judge_seconds", "gradient_seconds", "ratio", "commit")


def main() -> None:
    """Measures, as the arguments say."""
    path, *tasks = sys.argv[1:]
    jax.config.update("jax_enable_compilation_cache", False)
    rows = Rows(path, COLUMNS)
    for task in tasks:
        judge, gradient = measured(task)
        seconds = f"{judge:.2f}", f"{gradient:.2f}", f"{gradient / judge:.2f}"
        rows.add(dict(zip(COLUMNS, (task, *seconds), strict=False)))


def measured(task: str) -> tuple[float, float]:
    """Seconds for the judge's program, and for the gradient's."""
    problem = named_task(task).load()
    config = auto_preset(problem.domain_name).without_section("Search")
    planner = build_planner(problem, config, jit=quick_jit).planner
    params, key = planner.feedback_plan.noop(0), jax.random.PRNGKey(0)
    play = compile_exact_returns(planner, ROLLOUTS)
    one = jax.tree.map(lambda leaf: np.asarray(leaf)[np.newaxis], params)
    judge = _timed(lambda: play(key, one))
    guess = PerRestart(
        jax.tree.map(lambda leaf: np.repeat(leaf, planner.parallel_updates, axis=0), one)
    )
    training = Training(Built(planner, arguments={"guess": guess}), key, Budget(1000, 60.0))
    return judge, _timed(training.compile)


def _timed(call: Callable[[], Any]) -> float:
    began = time.monotonic()
    jax.block_until_ready(call())
    return time.monotonic() - began


if __name__ == "__main__":
    main()
