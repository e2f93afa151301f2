"""Trains and evaluates the cells of the paper's table."""

import logging
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jax import random

from benchmarks.paper.cells import (
    Cell,
    PaperSize,
    Trained,
    load_policies,
    load_trained,
    open_played,
    save_trained,
)
from benchmarks.paper.exact import exact_problem, iterate_returns, problem_of
from benchmarks.paper.gradient import train_by_gradient
from benchmarks.paper.iterates import kept_iterations
from benchmarks.paper.methods import method_config
from benchmarks.paper.names import ADAPTIVE, PPO
from benchmarks.paper.ppo import train_ppo
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.executors import Executor
from mdpo_rddl.machine.jax_setup import use_all_cores
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.planner.training.training import select_restart
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

logger = logging.getLogger(__name__)

_KEY = 0


def run_paper(
    out: Path,
    settings: Iterable[str],
    methods: Iterable[str],
    size: PaperSize,
    executor: Executor,
) -> None:
    """Measures every cell that is not there yet.

    Args:
      out: results folder.
      settings, methods: of the cells.
      size: of each cell.
      executor: where a cell is measured.
    """
    methods = list(methods)
    cells = [Cell(out, setting, method, size) for setting in settings for method in methods]
    executor.run(run_cell, [cell for cell in cells if not _is_done(cell)])


def run_cell(cell: Cell) -> None:
    """Trains and evaluates one cell; what an earlier run has left is not done again.

    Raises:
      InputError: if its folder holds results made under other conditions.
    """
    use_all_cores()
    trained = _kept_training(cell)
    if trained is None:
        trained = _train(cell)
    played = open_played(cell.folder, cell.size.episodes)
    missing = [seed for seed in range(cell.size.seeds) if not played.has(seed)]
    if not missing:
        return
    exact = exact_problem(cell.setting, cell.size.rollouts)
    env, policies = make_environment(exact.problem), load_policies(cell.folder)
    hyperparams = unit_hyperparams(exact.planner)
    for seed in missing:
        started = time.perf_counter()
        policy = playable(exact.planner, select_restart(policies, seed), hyperparams, seed)
        returns = evaluate(env, policy, cell.size.episodes, seed).returns
        text = " ".join(f"{value:.3f}" for value in returns)
        played.add(seed, text, round(time.perf_counter() - started, 2))
    logger.info("%s %s: played", cell.setting, cell.method)


def _is_done(cell: Cell) -> bool:
    if _kept_training(cell) is None:
        return False
    played = open_played(cell.folder, cell.size.episodes)
    return all(played.has(seed) for seed in range(cell.size.seeds))


def _kept_training(cell: Cell) -> Trained | None:
    """What the folder holds, if it has seeds enough."""
    trained = load_trained(cell.folder)
    if trained is None:
        return None
    for name, value in _conditions(cell).items():
        if trained.conditions.get(name) != value:
            raise InputError(
                f"{cell.folder}: holds results made with another {name}; use another --out"
            )
    return trained if trained.seeds >= cell.size.seeds else None


def _train(cell: Cell) -> Trained:
    started = time.perf_counter()
    problem = problem_of(cell.setting)
    config = method_config(problem.domain_name, cell.method, cell.size.seeds)
    key = random.PRNGKey(_KEY)
    kept = kept_iterations(cell.size.iterations)
    if cell.method == PPO:
        training = train_ppo(problem, config, key, kept)
    else:
        training = train_by_gradient(problem, cell.method, config, key, kept)
    iterates = list(training)
    after_training = time.perf_counter()
    returns = iterate_returns(cell.setting, cell.size.rollouts, iterates)
    sigmas = [i.sigma for i in iterates if i.sigma is not None and cell.method == ADAPTIVE]
    train_seconds = iterates[-1].seconds
    trained = Trained(
        conditions={**_conditions(cell), "versions": versions("optax", "rejax")},
        seconds={
            "compile": round(after_training - started - train_seconds, 2),
            "train": round(train_seconds, 2),
            "evaluate": round(time.perf_counter() - after_training, 2),
        },
        iterations=kept,
        elapsed=[round(iterate.seconds, 3) for iterate in iterates],
        returns=returns.mean(axis=2).T,
        last_returns=returns[-1],
        sigma=np.stack(sigmas) if sigmas else None,
    )
    save_trained(cell.folder, trained, iterates[-1].params)
    logger.info("%s %s: trained in %.0f s", cell.setting, cell.method, train_seconds)
    return trained


def _conditions(cell: Cell) -> dict[str, Any]:
    problem = problem_of(cell.setting)
    config = method_config(problem.domain_name, cell.method, 1)
    return {
        "problem": problem.digest,
        "iterations": cell.size.iterations,
        "rollouts": cell.size.rollouts,
        "configuration": config.to_text(),
    }
