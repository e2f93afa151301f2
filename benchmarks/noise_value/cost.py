"""What an iteration costs with each rule, measured in turn with one without noise."""

import json
import logging
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import random

from benchmarks.noise_value.cells import Cell
from benchmarks.noise_value.methods import NONE, task_config
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.files import read_json, write_atomically
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import A_DAY, Budget
from mdpo_rddl.problem.load import Problem, load_problem

logger = logging.getLogger(__name__)

SECTIONS: Mapping[str, dict[str, Any] | None] = {
    NONE: {"method": "NoNoise"},
    "constant": {"method": "ConstantNoise"},
    "default": None,
    "adaptive": {"method": "AdaptiveNoise"},
}
"""Per method its section `[Noise]`; None for none, which is the planner's default."""

_ROUNDS, _BLOCK = 7, 20


def run_costs(cells: Iterable[Cell]) -> None:
    """Measures the cost of every cell's problem, plan and configuration that has no file yet."""
    for cell in cells:
        path = cost_path(cell)
        if path.exists():
            continue
        try:
            problem = load_problem(cell.problem, cell.instance)
            if problem.horizon > cell.max_horizon:
                problem = load_problem(cell.problem, cell.instance, cell.max_horizon)
            found = measure(problem, cell)
        except Exception as error:  # the other problems are measured
            logger.warning("%s: no costs: %s", path.stem, one_line_cause(error))
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        names = {"problem": cell.problem, "plan": cell.plan, "configuration": cell.configuration}
        write_atomically(path, (json.dumps({**names, **found}, indent=1) + "\n").encode())
        jax.clear_caches()


def cost_path(cell: Cell) -> Path:
    """The file of a cell's costs."""
    return cell.out / "cost" / cell.path.name


def measure(problem: Problem, cell: Cell) -> dict[str, Any]:
    """CPU time of compiling and of an iteration per method, in blocks that take turns.

    Args:
      problem: of the cell, with its horizon.
      cell: whose configuration is measured, with its own number of parallel updates.
    """
    config = task_config(cell.problem, cell.plan, cell.configuration, seeds=1)
    loops: dict[str, Iterator[Any]] = {}
    compiling: dict[str, float] = {}
    for name, section in SECTIONS.items():
        started = time.process_time()
        noisy = config if section is None else config.with_section("Noise", section)
        built = build_planner(problem, noisy)
        loops[name] = built.callbacks(random.PRNGKey(0), Budget(1 + _ROUNDS * _BLOCK, A_DAY))
        next(loops[name])
        compiling[name] = time.process_time() - started
    blocks: dict[str, list[float]] = {name: [] for name in loops}
    for _ in range(_ROUNDS):
        for name, loop in loops.items():
            started = time.process_time()
            for _ in range(_BLOCK):
                next(loop)
            blocks[name].append(1000.0 * (time.process_time() - started) / _BLOCK)
    base = np.array(blocks[NONE])
    return {
        "compile_seconds": {name: round(value, 1) for name, value in compiling.items()},
        "iteration_ms": {name: round(float(np.median(b)), 3) for name, b in blocks.items()},
        "ratio": {name: float(np.median(np.array(b) / base)) for name, b in blocks.items()},
    }


def read_costs(out: Path) -> list[dict[str, Any]]:
    """The costs of a folder.

    Raises:
      InputError: if a file holds none.
    """
    found = []
    for path in sorted((out / "cost").glob("*.json")):
        try:
            kept = read_json(path)
            kept["ratio"][NONE], kept["compile_seconds"][NONE], kept["iteration_ms"][NONE]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: holds no costs of noise-value") from error
        found.append(kept)
    return found
