"""What compiler options bear on rollouts of the exact model: time to compile, and to run.

    PYTHONPATH=. python tools/rollout_programs.py ROWS PROBLEM:INSTANCE...

For each problem the judge's program (128 rollouts of one feedback policy) and that of a population
are compiled with each of `OPTIONS`, twice, and played in turn; all times are the processor's, in
seconds, without tracing, the shortest of the two and of `CALLS` for a call. Rows are added to ROWS.
Run it on one core.
"""

import math
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from rows import Rows

from benchmarks.tasks.naming import named_task
from mdpo_rddl.auto.common.sizes import fitting_size
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.programs.quick import LIGHT, QUICK_OPTIONS

OPTIONS: dict[str, dict[str, Any] | None] = {"default": {}, "light": LIGHT, "quick": QUICK_OPTIONS}
CALLS = 12
_JUDGE_ROLLOUTS = 128
COLUMNS = ("problem", "program", "options", "compile_seconds", "call_seconds", "commit")


def main() -> None:
    """Measures, as the arguments say."""
    path, *tasks = sys.argv[1:]
    rows = Rows(path, COLUMNS)
    for task in tasks:
        for row in measured(task):
            rows.add(dict(zip(COLUMNS, (task, *row), strict=False)))


def measured(task: str) -> list[tuple[str, str, str, str]]:
    """Program, options, seconds of compilation and of a call."""
    problem = named_task(task).load()
    config = auto_preset(problem.domain_name).without_section("Search")
    planner = build_planner(problem, config).planner
    noop, size = planner.feedback_plan.noop(0), fitting_size(planner)
    found = []
    for program, rollouts, count in (
        ("judge", _JUDGE_ROLLOUTS, 1),
        ("population", size.rollouts, size.population),
    ):
        many = jax.tree.map(
            lambda leaf, count=count: np.broadcast_to(leaf, (count, *np.shape(leaf))), noop
        )
        arguments = (jax.random.PRNGKey(0), many)
        # plain, whatever the library's own options are
        plain = jax.jit(compile_exact_returns(planner, rollouts).__wrapped__)  # type: ignore[attr-defined]
        compiled, seconds = {}, dict.fromkeys(OPTIONS, math.inf)
        # there and back: whatever is compiled first or last may have an advantage
        for label in (*OPTIONS, *reversed(OPTIONS)):
            jax.clear_caches()
            lowered = plain.lower(*arguments)
            began = time.process_time()
            compiled[label] = lowered.compile(compiler_options=OPTIONS[label])
            seconds[label] = min(seconds[label], time.process_time() - began)
        calls: dict[str, list[float]] = {label: [] for label in OPTIONS}
        for _ in range(CALLS):
            for label, play in compiled.items():
                calls[label].append(_timed(play, arguments))
        found += [(program, n, f"{seconds[n]:.3f}", f"{min(calls[n]):.5f}") for n in OPTIONS]
    return found


def _timed(play: Callable[..., Any], arguments: tuple[Any, ...]) -> float:
    began = time.process_time()
    jax.block_until_ready(play(*arguments))
    return time.process_time() - began


if __name__ == "__main__":
    main()
