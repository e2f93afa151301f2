"""Trains and evaluates the cells."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import random

from mdpo_rddl.bench.common.full_training import train_fully
from mdpo_rddl.bench.noise_value.cells import OK, Cell, load, save
from mdpo_rddl.bench.noise_value.methods import NONE, cell_config
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.executors import Executor
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.returns import compile_returns
from mdpo_rddl.planner.training import Record, TrainingResult
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

logger = logging.getLogger(__name__)

_CURVE_POINTS = 60
# no key of a training: those are 0, 1, ...
_EVALUATION_KEY = 2**31 - 1
_NOOP_EPISODES = 10


@dataclass(frozen=True)
class Shard:
    """Every `count`-th cell from `index`, counted from 1, for machines that share the work."""

    index: int = 1
    count: int = 1


def run_noise_value(cells: Iterable[Cell], executor: Executor, shard: Shard = Shard()) -> None:
    """Measures every cell that has no file yet.

    Args:
      cells: in the order in which they are measured.
      executor: where a cell is measured.
      shard: which of the cells are measured here.
    """
    mine = list(cells)[shard.index - 1 :: shard.count]
    executor.run(run_cell, [cell for cell in mine if load(cell) is None])


def all_cells(
    problems: Iterable[tuple[str, str]],
    plans: Iterable[str],
    configurations: Iterable[str],
    methods: Iterable[str],
    **sizes: Any,
) -> list[Cell]:
    """The cells of a measurement; `sizes` are the other attributes of `Cell`."""
    plans, configurations, methods = list(plans), list(configurations), list(methods)
    return [
        Cell(
            problem=problem,
            instance=instance,
            plan=plan,
            configuration=configuration,
            method=method,
            **sizes,
        )
        for problem, instance in problems
        for plan in plans
        for configuration in configurations
        for method in methods
    ]


def run_cell(cell: Cell) -> None:
    """Trains and evaluates one cell; an error becomes its status."""
    try:
        result = _measure(cell)
    except Exception as error:  # whatever it is, it is the finding
        result = {"status": one_line_cause(error)}
    save(cell, result)
    logger.info("%s: %s %s", cell.path.stem, result["status"], result.get("returns", ""))
    jax.clear_caches()


def _measure(cell: Cell) -> dict[str, Any]:
    problem = load_problem(cell.problem, cell.instance)
    if problem.horizon > cell.max_horizon:
        problem = load_problem(cell.problem, cell.instance, cell.max_horizon)
    config = cell_config(cell.problem, cell.plan, cell.configuration, cell.method)
    built = build_planner(problem, config)
    planner = built.planner
    results = [
        train_fully(built, random.PRNGKey(seed), cell.iterations) for seed in range(cell.seeds)
    ]
    points = _curve_points(results[0].history)
    return {
        "status": OK,
        "returns": _exact_returns(planner, results, cell.rollouts),
        "noop": _noop_return(problem) if cell.method == NONE else None,
        "compile_seconds": round(results[0].compile_seconds, 2),
        "train_seconds": [round(result.train_seconds, 3) for result in results],
        "curve_iterations": [int(results[0].history[i].iteration) for i in points],
        "curves": [_best_so_far(result.history, points) for result in results],
        "units": {
            name: np.broadcast_to(spec.unit, spec.shape).ravel().tolist()
            for name, spec in planner.action_specs.items()
        },
    }


def _exact_returns(
    planner: MDPOPlanner, results: list[TrainingResult], rollouts: int
) -> list[float]:
    """Each seed's mean return, on episodes that all methods share."""
    params = jax.tree.map(lambda *leaves: jnp.stack(leaves), *[r.best_params for r in results])
    returns = compile_returns(planner)
    turns = -(-rollouts // planner.batch_size_test)
    means = []
    for key in random.split(random.PRNGKey(_EVALUATION_KEY), turns):
        means.append(np.mean(returns(random.split(key, len(results)), params), axis=1))
    return [float(value) for value in np.mean(means, axis=0)]


def _noop_return(problem: Problem) -> float:
    return evaluate(make_environment(problem), lambda step, state: {}, _NOOP_EPISODES, 0).mean


def _curve_points(history: tuple[Record, ...]) -> list[int]:
    count = min(_CURVE_POINTS, len(history))
    return sorted({int(i) for i in np.linspace(0, len(history) - 1, count)})


def _best_so_far(history: tuple[Record, ...], points: list[int]) -> list[float]:
    best = np.maximum.accumulate([record.test_return for record in history])
    return [float(best[i]) for i in points]
