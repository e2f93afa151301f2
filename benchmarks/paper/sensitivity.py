"""How much adaptive noise depends on each of its choices, one changed at a time."""

import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jax import random

from benchmarks.common.records import Records, mean_and_spread
from benchmarks.paper.exact import iterate_returns, problem_of
from benchmarks.paper.gradient import DivergedError, train_by_gradient
from benchmarks.paper.iterates import LAST, kept_iterations
from benchmarks.paper.methods import method_config
from benchmarks.paper.names import (
    ACTIVATION,
    ADAPTIVE,
    AFTER,
    BASE,
    ENTRY,
    FACTORS,
    SENSITIVITY_SETTINGS,
    WEIGHT,
)
from benchmarks.paper.relaxation import with_relaxation
from mdpo_rddl.noise.projection import project_and_perturb
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets.paper import with_decay
from mdpo_rddl.planner.planner import MDPOPlanner

logger = logging.getLogger(__name__)

COLUMNS = ("setting", "factor", "value", "seed", "last_5")
KEYS = COLUMNS[:4]
_KEY = 0


class LatePlanner(MDPOPlanner):
    """MDPO with the noise behind the projection, as the paper's equations read."""

    perturb = staticmethod(project_and_perturb)


class Variant(NamedTuple):
    """One choice that differs from the table's, or none."""

    factor: str
    value: Any


def run_sensitivity(
    out: Path,
    settings: Iterable[str],
    factors: Iterable[str],
    seeds: int,
    iterations: int,
    rollouts: int,
) -> Records:
    """Trains every variant and records each seed's mean exact return over the last iterates.

    Variants that `out/sensitivity.csv` holds already are skipped.

    Args:
      out: results folder.
      settings: names of settings.
      factors: keys of `FACTORS`.
      seeds: number of seeds.
      iterations: of training.
      rollouts: of each iterate on the exact compiled model.
    """
    configs = {setting: _table_config(setting, 1).to_text() for setting in SENSITIVITY_SETTINGS}
    conditions = {"iterations": iterations, "rollouts": rollouts, "configurations": configs}
    records = Records(out / "sensitivity.csv", COLUMNS, KEYS, conditions)
    variants = [Variant(BASE, ""), *(Variant(f, v) for f in factors for v in FACTORS[f])]
    for setting in settings:
        for variant in variants:
            if all(records.has(setting, *variant, seed) for seed in range(seeds)):
                continue
            returns = _last_returns(setting, variant, seeds, iterations, rollouts)
            for seed, value in enumerate(returns):
                if not records.has(setting, *variant, seed):
                    records.add(setting, *variant, seed, round(float(value), 2))
            logger.info("%s, %s %s: done", setting, *variant)
    return records


def _table_config(setting: str, seeds: int) -> PlannerConfig:
    return method_config(problem_of(setting).domain_name, ADAPTIVE, seeds)


def _last_returns(
    setting: str, variant: Variant, seeds: int, iterations: int, rollouts: int
) -> np.ndarray:
    """Per seed, the mean exact return of the last iterates [S]."""
    config = _changed(_table_config(setting, seeds), variant)
    planner_class = LatePlanner if variant == (ENTRY, AFTER) else MDPOPlanner
    kept = kept_iterations(iterations)[-LAST:]
    training = train_by_gradient(
        problem_of(setting), ADAPTIVE, config, random.PRNGKey(_KEY), kept, planner_class
    )
    try:
        iterates = list(training)
    except DivergedError:
        return np.full(seeds, np.nan)
    activation = variant.value if variant.factor == ACTIVATION else None
    return iterate_returns(setting, rollouts, iterates, activation).mean(axis=(0, 2))


def _changed(config: PlannerConfig, variant: Variant) -> PlannerConfig:
    factor, value = variant
    if factor == WEIGHT:
        return with_relaxation(config, value, values_too=False)
    if factor in (BASE, ENTRY):
        return config
    if factor == "decay":
        return with_decay(config, value)
    if factor in (ACTIVATION, "initializer"):
        return config.with_policy_arguments(**{factor: value})
    return config.with_values("Noise", **{factor: value})


def sensitivity_table(records: Records) -> str:
    """Markdown: mean and deviation over seeds per factor and value; the table's choice first."""
    groups: dict[tuple[str, str], dict[str, list[float]]] = {}
    settings: list[str] = []
    for row in records.rows:
        cell = groups.setdefault((row["factor"], row["value"]), {})
        cell.setdefault(row["setting"], []).append(float(row["last_5"]))
        if row["setting"] not in settings:
            settings.append(row["setting"])
    lines = [
        "| factor | value | " + " | ".join(settings) + " |",
        "|" + "---|" * (len(settings) + 2),
    ]
    order = [BASE, *FACTORS]
    for (factor, value), by_setting in sorted(groups.items(), key=lambda g: order.index(g[0][0])):
        cells = [mean_and_spread(by_setting.get(setting, [])) for setting in settings]
        lines.append(f"| {factor} | {value} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
