"""What a straight-line plan returns with JaxPlan's optimiser, and with that of the arm `slp`.

    PYTHONPATH=. python tools/plan_optimisers.py ROWS SECONDS SEED ROLLOUTS PROBLEM:INSTANCE...

For each problem and each of `OPTIMISERS`, the plan is trained for SECONDS of the processor's time;
where nothing more is gained its steps shrink, as the arm's do. An iteration makes so many ROLLOUTS,
and so does a test: 1 where chance plays no part in the return, 0 for as many as the configuration
says. A row with the best iterate's return in the exact compiled model is added to ROWS for each.
Compilation is not counted. Run it on one core, with XLA_FLAGS=--xla_cpu_multi_thread_eigen=false.
"""

import sys
import time
from typing import Any

import jax
import jax.numpy as jnp
from mdpo_rddl.auto.search.steps import has_stalled, step_factor
from rows import Rows

from benchmarks.tasks.naming import named_task
from mdpo_rddl.auto.arena.plain import STRAIGHT_LINE, PlainPlanners
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.presets.by_domain import config_for_domain
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.update.restarts import PerRestart
from mdpo_rddl.problem.load import Problem

OPTIMISERS = ("JaxPlan's", "JaxPlan's, twice the steps", "Adam, twice the steps")
COLUMNS = ("problem", "optimiser", "seconds", "seed", "rollouts", "iterations", "return", "commit")
_FOREVER = Budget(10_000_000, 1e9)


def built_with(problem: Problem, name: str, optimiser: str, rollouts: int) -> Built[MDPOPlanner]:
    """The arm's planner of plans with one of `OPTIMISERS`."""
    config = PlainPlanners(problem).config(STRAIGHT_LINE)
    if rollouts:
        config = config.with_values("Planner", batch_size_train=rollouts, batch_size_test=rollouts)
    if optimiser != OPTIMISERS[-1]:
        theirs = config_for_domain(name, problem.domain_name, STRAIGHT_LINE).section("Planner")
        rate = theirs["optimizer_kwargs"]["learning_rate"]
        rate *= 1.0 if optimiser == OPTIMISERS[0] else 2.0
        given = {**theirs["optimizer_kwargs"], "learning_rate": rate}
        config = config.with_values(
            "Planner", optimizer=theirs["optimizer"], optimizer_kwargs=given
        )
    return build_planner(problem, config)


def trained(built: Built[MDPOPlanner], seconds: float, seed: int) -> tuple[float, int]:
    """The best iterate's return after so many seconds, and how many iterations there were."""
    planner, key = built.planner, jax.random.PRNGKey(seed)
    rate = planner.optimizer_kwargs["learning_rate"]
    best, params, done, spent, phase = -float("inf"), None, 0, 0.0, 0
    while spent < seconds:
        planner.vary_restarts(learning_rate=[rate * step_factor(phase)])
        guess: dict[str, Any] = {} if params is None else {"guess": PerRestart(params)}
        began, iteration = None, 0
        turns = built.with_arguments(**guess).callbacks(jax.random.fold_in(key, phase), _FOREVER)
        for turn in turns:
            now = time.process_time()
            # the first turn of all is compiled, and no phase's is counted
            began = now if began is None else began
            iteration = turn["iteration"] + 1
            if turn["best_return"] > best:
                best = float(turn["best_return"])
                params = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], turn["best_params"])
            if spent + now - began >= seconds:
                break
            if has_stalled(iteration, turn["last_iteration_improved"] + 1):
                break
        turns.close()
        spent, done, phase = (
            spent + time.process_time() - (began or 0.0),
            done + iteration,
            phase + 1,
        )
    return best, done


def main() -> None:
    """Adds the rows."""
    path, seconds, seed, rollouts, *tasks = sys.argv[1:]
    rows = Rows(path, COLUMNS)
    for task in tasks:
        named = named_task(task)
        problem = named.load()
        for optimiser in OPTIMISERS:
            built = built_with(problem, named.problem, optimiser, int(rollouts))
            found, count = trained(built, float(seconds), int(seed))
            measured = task, optimiser, seconds, seed, rollouts, count, f"{found:.6g}"
            rows.add(dict(zip(COLUMNS, measured, strict=False)))


if __name__ == "__main__":
    main()
