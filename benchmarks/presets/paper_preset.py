"""The paper preset against the bounds that the project set itself, seed by seed."""

import logging
from collections.abc import Iterable
from pathlib import Path

import jax

from benchmarks.common.full_training import train_fully
from benchmarks.common.names import SETTINGS
from benchmarks.common.records import Records, mean_and_spread
from benchmarks.common.settings import load_setting
from benchmarks.common.size import Size
from benchmarks.common.table1 import TABLE
from benchmarks.presets.names import NOISES
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.config.presets.paper import NOISE_BY_DOMAIN, with_decay
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

logger = logging.getLogger(__name__)

COLUMNS = ("setting", "noise", "seed", "last_return", "best_return", "train_seconds")
KEYS = COLUMNS[:3]

# without noise and with adaptive noise
_METHODS = ("deterministic", "adaptive")


def run_paper_preset(
    out: Path,
    settings: Iterable[str],
    noises: Iterable[str],
    size: Size,
    decay: float | None = None,
) -> Records:
    """Runs `--preset paper` with and without noise, as `mdpo-plan --seed 0, 1, ...` does.

    Runs that `out/runs.csv` holds already are skipped.

    Args:
      out: results folder.
      settings: names of settings.
      noises: keys of `NOISES`.
      size: of each measurement.
      decay: RMSProp's decay; the preset's if None.
    """
    presets = {name: _preset(name, decay).to_text() for name in NOISE_BY_DOMAIN}
    conditions = {
        "iterations": size.iterations,
        "episodes": size.episodes,
        "configuration": presets,
    }
    records = Records(out / "runs.csv", COLUMNS, KEYS, conditions)
    for setting in settings:
        problem = load_setting(setting)
        preset = _preset(problem.domain_name, decay)
        for noise in noises:
            section = NOISES[noise]
            open_seeds = [s for s in range(size.seeds) if not records.has(setting, noise, s)]
            if not open_seeds:
                continue
            config = preset if section is None else preset.with_section("Noise", section)
            built = build_planner(problem, config)
            for seed in open_seeds:
                result = train_fully(built, jax.random.PRNGKey(seed), size.iterations)
                returns = [
                    evaluate(
                        make_environment(problem),
                        playable(built.planner, params, result.policy_hyperparams, seed),
                        size.episodes,
                        seed,
                    ).mean
                    for params in (result.last_params, result.best_params)
                ]
                records.add(setting, noise, seed, *returns, round(result.train_seconds, 2))
                logger.info("%s, noise %s, seed %d: %.0f", setting, noise, seed, returns[0])
    return records


def _preset(domain_name: str, decay: float | None) -> PlannerConfig:
    return with_decay(PRESETS["paper"](domain_name), decay)


def paper_preset_table(records: Records) -> str:
    """Markdown: the last iterate's mean return over seeds, the paper's beside it."""
    lines = [
        "| setting | seeds | none | paper's | adaptive | paper's | adaptive, best iterate |",
        "|---|---|---|---|---|---|---|",
    ]
    for setting in SETTINGS:
        paper_none, paper_adaptive = (TABLE[setting, method].mean for method in _METHODS)
        last = {noise: _returns(records, setting, noise, "last_return") for noise in NOISES}
        if not any(last.values()):
            continue
        best = _returns(records, setting, "adaptive", "best_return")
        cells = [
            setting,
            str(max(map(len, last.values()))),
            mean_and_spread(last["none"]),
            f"{paper_none:,.0f}",
            mean_and_spread(last["adaptive"]),
            f"{paper_adaptive:,.0f}",
            mean_and_spread(best),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _returns(records: Records, setting: str, noise: str, column: str) -> list[float]:
    return [
        float(row[column])
        for row in records.rows
        if (row["setting"], row["noise"]) == (setting, noise)
    ]
