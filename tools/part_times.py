"""What the parts of a feedback policy cost in rollouts of the exact model.

    PYTHONPATH=. python tools/part_times.py ROWS PROBLEM:INSTANCE...

For each problem a population of a search (32 policies, four rollouts of each) is compiled and
played with parameters of all parts, and with those of a rule and of a plan alone, the others of
which have no effect (`mdpo_rddl.planner.plans.parts`), without JAX's cache. Times are by the clock:
seconds to compile, and milliseconds of a call, the shortest of forty. Rows are added to ROWS. Run
it on one core, with nothing beside it.
"""

import sys
import time
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from rows import Rows

from benchmarks.tasks.naming import named_task
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.plans.parts import idle_parts, open_loop

COLUMNS = ("problem", "parts", "compile_seconds", "call_milliseconds", "commit")
POLICIES, ROLLOUTS, CALLS = 32, 4, 40


def main() -> None:
    """Measures, as the arguments say."""
    path, *tasks = sys.argv[1:]
    jax.config.update("jax_enable_compilation_cache", False)
    rows = Rows(path, COLUMNS)
    for task in tasks:
        for name, compiling, call in measured(task):
            numbers = f"{compiling:.2f}", f"{1000 * call:.2f}"
            rows.add(dict(zip(COLUMNS, (task, name, *numbers), strict=False)))


def measured(task: str) -> Iterator[tuple[str, float, float]]:
    """For each set of parts its name, seconds to compile and seconds of a call."""
    problem = named_task(task).load()
    config = auto_preset(problem.domain_name).without_section("Search")
    planner = build_planner(problem, config).planner
    whole = planner.feedback_plan.noop(0)
    idle = idle_parts(whole)
    rule = {name: part for name, part in whole.items() if name not in idle}
    plan = open_loop(whole)
    key = jax.random.PRNGKey(0)
    for name, params in (("all", whole), ("rule", rule), ("plan", plan)):
        play = compile_exact_returns(planner, ROLLOUTS)
        each = jax.tree.map(lambda leaf: np.repeat(leaf[np.newaxis], POLICIES, axis=0), params)
        first, *calls = (_seconds(play, key, each) for _ in range(1 + CALLS))
        yield name, max(0.0, first - min(calls)), min(calls)


def _seconds(play: Any, key: Any, params: Any) -> float:
    began = time.monotonic()
    jax.block_until_ready(play(key, params))
    return time.monotonic() - began


if __name__ == "__main__":
    main()
