"""Trains and evaluates the cells."""

import logging
import time
from collections.abc import Iterable, Mapping
from typing import Any

import jax
import numpy as np
from jax import random

from benchmarks.noise_value.cells import LIMIT, OK, Cell, is_missing, save
from benchmarks.noise_value.exact import mean_returns
from benchmarks.noise_value.lanes import (
    TooLongError,
    Trained,
    best_curve,
    best_of,
    train_lanes,
)
from benchmarks.noise_value.methods import (
    ABSOLUTE,
    METHODS,
    NONE,
    RANGE,
    Lane,
    has_pgpe,
    lanes,
    task_config,
    with_rule,
)
from benchmarks.noise_value.signs import signs
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.executors import Executor
from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.noise.actions import ActionSpec
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import other_start
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

logger = logging.getLogger(__name__)

_CURVE_POINTS = 40
_NOOP_EPISODES = 10


def run_noise_value(
    cells: Iterable[Cell], executor: Executor, shard: tuple[int, int] = (0, 1)
) -> None:
    """Measures every cell that has no file yet, or was left out and has more time now.

    Args:
      cells: in the order in which they are measured.
      executor: where a cell is measured.
      shard: (i, n): only every n-th cell, from the i-th on.
    """
    number, count = shard
    mine = list(cells)[number::count]
    executor.run(run_cell, [cell for cell in mine if is_missing(cell)])


def all_cells(
    problems: Iterable[tuple[str, str]],
    plans: Iterable[str],
    configurations: Iterable[str],
    **sizes: Any,
) -> list[Cell]:
    """The cells of a measurement; `sizes` are the other attributes of `Cell`.

    Where JaxPlan's own configuration has no PGPE, it is the one without and is measured once.
    """
    plans, configurations = list(plans), list(configurations)
    cells = []
    for problem, instance in problems:
        for plan in plans:
            own = task_config(problem, plan, "own", sizes["seeds"])
            for name in configurations:
                if name == "own" and "no-pgpe" in configurations and not has_pgpe(own):
                    continue
                named: dict[str, Any] = {"problem": problem, "instance": instance, "plan": plan}
                cells.append(Cell(**named, configuration=name, **sizes))
    return cells


def run_cell(cell: Cell) -> None:
    """Trains and evaluates one cell; an error becomes its status."""
    try:
        result = _measure(cell)
    except TooLongError as error:
        result = {"status": f"left out: {error}", LIMIT: cell.most_seconds}
    except Exception as error:  # whatever it is, it is the finding
        result = {"status": one_line_cause(error)}
    save(cell, result)
    logger.info("%s: %s", cell.path.stem, result["status"])
    jax.clear_caches()


def _measure(cell: Cell) -> dict[str, Any]:
    started = time.process_time()
    problem = load_problem(cell.problem, cell.instance)
    if problem.horizon > cell.max_horizon:
        problem = load_problem(cell.problem, cell.instance, cell.max_horizon)
    config = task_config(cell.problem, cell.plan, cell.configuration, cell.seeds)
    planners = _planners(problem, config)
    trained, returns = {}, {}
    for name, lane in lanes(cell.sigma).items():
        built, rule = _prepared(planners, lane)
        built.planner.noise = rule
        sizes = cell.iterations, cell.seeds, cell.most_seconds
        with other_start(built.planner, lane.stream):
            trained[name] = train_lanes(built, random.PRNGKey(0), *sizes)
        returns[name] = mean_returns(planners[RANGE].planner, trained[name].params, cell.rollouts)
    points = _curve_points(cell.iterations)
    planner = planners[RANGE].planner
    return {
        "status": OK,
        "noop": evaluate(make_environment(problem), _no_op, _NOOP_EPISODES, 0).mean,
        "curve_iterations": points,
        "methods": {
            name: _of_method([trained[n] for n in names], [returns[n] for n in names], points)
            for name, names in METHODS.items()
        },
        "signs": signs(planner, trained[NONE]),
        "cpu_seconds": round(time.process_time() - started, 1),
        "training_seconds": {name: round(t.seconds, 2) for name, t in trained.items()},
        "units": {
            name: np.broadcast_to(spec.unit, spec.shape).ravel().tolist()
            for name, spec in planner.action_specs.items()
        },
    }


def _no_op(step: int, state: Any) -> dict[str, Any]:
    return {}


def _planners(problem: Problem, config: PlannerConfig) -> dict[str, Built[MDPOPlanner]]:
    """The planner of each unit, one alone where a program of its own is not needed."""
    ranged = build_planner(problem, with_rule(config, RANGE))
    if common_unit(ranged.planner.action_specs) is not None:
        return {RANGE: ranged}
    return {RANGE: ranged, ABSOLUTE: build_planner(problem, with_rule(config, ABSOLUTE))}


def _prepared(
    planners: Mapping[str, Built[MDPOPlanner]], lane: Lane
) -> tuple[Built[MDPOPlanner], ActionNoise]:
    """The planner of a training, and its rule in that planner's unit."""
    if lane.unit in planners:
        return planners[lane.unit], lane.rule()
    built = planners[RANGE]
    unit = common_unit(built.planner.action_specs)
    assert unit is not None  # else there is a planner for it
    return built, lane.in_range_units(unit)


def common_unit(specs: Mapping[str, ActionSpec]) -> float | None:
    """The unit that all components share, so that absolute noise is the same with another sigma.

    Returns:
      None if they have several, or a squashing function lies between.
    """
    units = [np.ravel(spec.unit) for spec in specs.values()]
    found = np.unique(np.concatenate([np.ones(0), *units]))
    if len(found) != 1 or any(spec.squashed for spec in specs.values()):
        return None
    return float(found[0])


def _of_method(trained: list[Trained], returns: list[np.ndarray], points: list[int]) -> Any:
    curves = best_curve(trained)
    return {
        "returns": best_of(trained, returns).tolist(),
        "tested": np.max([t.best for t in trained], axis=0).tolist(),
        "curves": curves[:, [min(i, curves.shape[1] - 1) for i in points]].tolist(),
    }


def _curve_points(iterations: int) -> list[int]:
    return sorted({int(i) for i in np.linspace(0, iterations - 1, min(_CURVE_POINTS, iterations))})
