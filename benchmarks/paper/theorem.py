"""Theorem 1 put to the test: the reparameterised gradient against finite differences.

The theorem says that the mean of the gradient along sampled trajectories is the gradient of the
expected return. It assumes that the return is smooth along them. So it must hold on a relaxed
model, and may not where JaxPlan's straight-through estimators pair exact values, which jump,
with relaxed gradients.
"""

from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import random
from jax.flatten_util import ravel_pytree

from benchmarks.common.full_training import train_fully
from benchmarks.common.records import Records
from benchmarks.paper.perturbed_returns import perturbed_mean_return
from benchmarks.paper.relaxation import with_relaxation
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.problem.load import load_problem

PROBLEM = "powergen2"
HORIZON = 10
SIGMA = 1.0
DIRECTIONS = 6
KEYS = ("model", "direction")
_BATCH, _STEP, _TRAINING = 200, 3e-3, 100


class Model(NamedTuple):
    """A relaxation: its weight, and whether its values are relaxed too or only its gradients."""

    weight: float
    values_too: bool

    @property
    def name(self) -> str:
        """What the table calls it."""
        values = "relaxed values" if self.values_too else "exact values"
        return f"w = {self.weight:g}, {values}"


MODELS = (Model(1.0, True), Model(10.0, True), Model(100.0, True), Model(100.0, False))


class Estimate(NamedTuple):
    """Means over batches [directions], and their standard errors; of the gap, pairwise."""

    gradient: np.ndarray
    gradient_error: np.ndarray
    difference: np.ndarray
    difference_error: np.ndarray
    gap_in_errors: np.ndarray


COLUMNS = (*KEYS, *Estimate._fields)


def run_theorem(out: Path, batches: int) -> Records:
    """Estimates directional derivatives of the expected return, in two ways.

    Either way takes the same random numbers. Models that `out/theorem.csv` holds are skipped.

    Args:
      out: results folder.
      batches: of 200 rollouts each.
    """
    conditions = {"batches": batches, "batch": _BATCH, "step": _STEP, "sigma": SIGMA}
    records = Records(out / "theorem.csv", COLUMNS, KEYS, conditions)
    for model in MODELS:
        if records.has(model.name, DIRECTIONS - 1):
            continue
        estimate = _estimate(model, batches)
        for direction, values in enumerate(zip(*estimate, strict=True)):
            if not records.has(model.name, direction):
                records.add(model.name, direction, *(f"{value:.4g}" for value in values))
    return records


def _estimate(model: Model, batches: int) -> Estimate:
    problem = load_problem(PROBLEM, horizon=HORIZON)
    built = build_planner(problem, _config(problem.domain_name, model))
    trained = train_fully(built, random.PRNGKey(0), _TRAINING)
    point, as_params = ravel_pytree(trained.last_params)
    directions = random.normal(random.PRNGKey(1), (DIRECTIONS, point.size))
    directions /= jnp.linalg.norm(directions, axis=1, keepdims=True)
    mean_return = perturbed_mean_return(built.planner, SIGMA)

    def of_batch(key):
        def value(point):
            return mean_return(key, as_params(point))

        def difference(direction):
            step = _STEP * direction
            return (value(point + step) - value(point - step)) / (2 * _STEP)

        return directions @ jax.grad(value)(point), jax.vmap(difference)(directions)

    keys = random.split(random.PRNGKey(2), batches)
    found = jax.jit(lambda keys: jax.lax.map(of_batch, keys))(keys)
    gradients, differences = (np.asarray(values, float) for values in found)
    gap, gap_error = _mean_and_error(gradients - differences)
    return Estimate(*_mean_and_error(gradients), *_mean_and_error(differences), gap / gap_error)


def _mean_and_error(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means over the first axis, and their standard errors."""
    return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))


def _config(domain_name: str, model: Model) -> PlannerConfig:
    config = PRESETS["paper"](domain_name)
    config = config.with_section("Noise", {"method": "ConstantNoise", "sigma": SIGMA})
    plan = {"batch_size_train": _BATCH, "batch_size_test": 1, "method_kwargs": {"topology": [4]}}
    config = config.with_values("Planner", **plan)
    return with_relaxation(config, model.weight, model.values_too)


def theorem_table(records: Records) -> str:
    """Markdown: both derivatives per model and direction, and their gap in standard errors."""
    lines = [
        "| model | direction | reparameterised | finite difference | gap in standard errors |",
        "|---|---|---|---|---|",
    ]
    for row in records.rows:
        cells = [
            row["model"],
            row["direction"],
            f"{row['gradient']} ± {row['gradient_error']}",
            f"{row['difference']} ± {row['difference_error']}",
            f"{float(row['gap_in_errors']):+.1f}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
