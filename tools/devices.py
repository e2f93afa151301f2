"""What rollouts of the exact model take on each device: time to compile, and of a step.

    PYTHONPATH=. python tools/devices.py ROWS PROBLEM:INSTANCE...

For each problem the judge's program (128 rollouts of one feedback policy) is compiled and played
on the device that JAX puts first and on the CPU: wall-clock seconds, those of a step from the
shortest of `CALLS` calls. `values` is what `mdpo_rddl.planner.device` decides by. Rows are added
to ROWS. Run it on one core: `taskset -c 0`.
"""

import sys
import time
from typing import Any

import jax
from rows import Rows

from benchmarks.tasks.naming import named_task
from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.sizes import step_values

CALLS = 5
_ROLLOUTS = 128
COLUMNS = (
    *("problem", "values", "horizon", "device", "compile_seconds", "step_milliseconds"),
    *("jax", "commit"),
)


def main() -> None:
    """Measures, as the arguments say."""
    path, *tasks = sys.argv[1:]
    jax.config.update("jax_enable_compilation_cache", False)
    devices = {each.platform: each for each in (jax.devices()[0], jax.devices("cpu")[0])}
    rows = Rows(path, COLUMNS)
    for task in tasks:
        problem = named_task(task).load()
        head = task, step_values(problem.model.ast), problem.horizon
        for device in devices.values():
            row = (*head, device.device_kind, *_measured(problem, device))
            print(*row, flush=True)
            rows.add(dict(zip(COLUMNS, (*row, jax.__version__), strict=False)))


def _measured(problem: Problem, device: Any) -> tuple[str, str]:
    """Seconds of compilation, tracing included, and milliseconds of a step."""
    with computing_on(device):
        config = auto_preset(problem.domain_name).without_section("Search")
        planner = build_planner(problem, config).planner
        one = jax.tree.map(lambda leaf: leaf[None], planner.feedback_plan.noop(0))
        play = compile_exact_returns(planner, _ROLLOUTS)
        seconds = [_timed(play, one) for _ in range(1 + CALLS)]
    step = min(seconds[1:]) / problem.horizon
    return f"{max(0.0, seconds[0] - min(seconds[1:])):.2f}", f"{1000.0 * step:.4f}"


def _timed(play: Any, params: Any) -> float:
    began = time.perf_counter()
    jax.block_until_ready(play(jax.random.PRNGKey(0), params))
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
