"""What a race leaves behind beside its summary."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdpo_rddl.machine.device import device_name
from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.policy.file import save_policy
from mdpo_rddl.session.race import RaceResult
from mdpo_rddl.session.report.run_folder import POLICY
from mdpo_rddl.session.report.summary import optimum_figures

COLUMNS = ("seconds", "arm", "candidate", "mean_return", "error", "became_incumbent")


def race_figures(result: RaceResult) -> dict[str, Any]:
    """How the race went, on what; `train_seconds` is what compilation has left of the time."""
    ended = "optimum_proven" if result.is_proven else "time_budget_reached"
    return {
        **optimum_figures(result.policy),
        "status": "interrupted" if result.interrupted else ended,
        "train_seconds": max(0.0, result.seconds - result.compile_seconds),
        "compile_seconds": result.compile_seconds,
        "device": device_name(),
        "versions": package_versions(),
        "auto": result.diagnostics,
    }


def write_race(folder: Path, result: RaceResult, summary: Mapping[str, Any]) -> None:
    """Writes the policy, the candidates and their picture, and the noise if the result used it.

    Args:
      folder: where.
      result: of the race.
      summary: with `race_figures`; what the pictures are made of.
    """
    from mdpo_rddl.session.report.race_figure import draw_race  # imports matplotlib

    save_policy(folder / POLICY, result.policy.to_saved())
    race = summary["auto"]
    head = (
        f"{summary['label']} (H = {summary['horizon']}), by {race['arm']}, seed {summary['seed']}"
    )
    with (folder / "candidates.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(race["candidates"])
    draw_race(folder / "learning_curve.png", race, head)
    if result.noise is not None:
        from mdpo_rddl.session.report.training import write_history  # imports JAX

        write_history(folder, result.noise.records, result.noise.sigma, head)
