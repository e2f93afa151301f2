"""Which alpha and sigma_max suit which domain, the paper's set-up otherwise unchanged.

The paper gives p = 0.95, sigma_min = 0 and sigma_max of 9 to 11, but not alpha.
"""

import logging
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax

from benchmarks.common.full_training import train_fully
from benchmarks.common.records import Records, mean_and_spread
from benchmarks.common.settings import load_setting
from benchmarks.common.size import Size
from mdpo_rddl.noise import AdaptiveNoise
from mdpo_rddl.noise.units import ABSOLUTE
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.config.presets.paper import PYTORCH_DECAY, with_decay
from mdpo_rddl.planner.training.training import select_restart
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

logger = logging.getLogger(__name__)


class NoisePoint(NamedTuple):
    """One choice of the noise's open numbers.

    Attributes:
      alpha, sigma_max: of `AdaptiveNoise`.
    """

    alpha: float
    sigma_max: float


COLUMNS = ("setting", "alpha", "sigma_max", "restart", "last_return")
KEYS = COLUMNS[:4]


def sweep(
    out: Path,
    settings: Iterable[str],
    grid: Sequence[NoisePoint],
    size: Size,
    decay: float = PYTORCH_DECAY,
) -> Records:
    """Trains every combination and records the last iterate's exact mean return.

    The seeds of one combination are the restarts of one planner, trained side by side from
    the key 0, which for the law of the results is the same as training them apart.
    Combinations that `out/sweep.csv` holds already are skipped.

    Args:
      out: results folder.
      settings: names of settings.
      grid: the combinations.
      size: of each measurement.
      decay: RMSProp's decay.
    """
    base = _sweep_config("any domain", size.seeds, decay).to_text(for_jaxplan=True)
    conditions = {
        "iterations": size.iterations,
        "episodes": size.episodes,
        "configuration": base,
    }
    records = Records(out / "sweep.csv", COLUMNS, KEYS, conditions)
    for setting in settings:
        open_points = [
            point
            for point in grid
            if not all(records.has(setting, *point, seed) for seed in range(size.seeds))
        ]
        if not open_points:
            continue
        problem = load_setting(setting)
        config = _sweep_config(problem.domain_name, size.seeds, decay)
        built = build_planner(problem, config)
        planner = built.planner
        env = make_environment(problem)
        for alpha, sigma_max in open_points:
            # the noise's numbers are arguments of the compiled update: nothing is recompiled
            planner.noise = AdaptiveNoise(alpha=alpha, sigma_max=sigma_max, unit=ABSOLUTE)
            result = train_fully(built, jax.random.PRNGKey(0), size.iterations)
            for seed in range(size.seeds):
                params = select_restart(result.last_params_by_restart, seed)
                policy = playable(planner, params, result.policy_hyperparams, seed)
                mean = evaluate(env, policy, size.episodes, seed).mean
                if not records.has(setting, alpha, sigma_max, seed):
                    records.add(setting, alpha, sigma_max, seed, mean)
            logger.info("%s: alpha %g, sigma_max %g done", setting, alpha, sigma_max)
    return records


def _sweep_config(domain_name: str, seeds: int, decay: float) -> PlannerConfig:
    config = with_decay(PRESETS["paper"](domain_name), decay)
    # only the last iterate is measured: no test rollouts are needed to pick another
    config = config.without_values("Optimize", "test_rolling_window")
    return config.with_values("Planner", parallel_updates=seeds, batch_size_test=1)


def sweep_table(records: Records) -> str:
    """Markdown: mean and standard deviation over seeds per setting, alpha and sigma_max."""
    groups: dict[tuple[float, float], dict[str, list[float]]] = {}
    settings: list[str] = []
    for row in records.rows:
        point = (float(row["sigma_max"]), float(row["alpha"]))
        groups.setdefault(point, {}).setdefault(row["setting"], []).append(
            float(row["last_return"])
        )
        if row["setting"] not in settings:
            settings.append(row["setting"])
    lines = [
        "| sigma_max | alpha | " + " | ".join(settings) + " |",
        "|" + "---|" * (len(settings) + 2),
    ]
    for (sigma_max, alpha), by_setting in sorted(groups.items()):
        cells = [mean_and_spread(by_setting.get(setting, [])) for setting in settings]
        lines.append(f"| {sigma_max:g} | {alpha:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
