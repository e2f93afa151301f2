"""What a race leaves behind beside its summary."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdpo_rddl.machine.device import current_device
from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.planner.device import fitting_device
from mdpo_rddl.policy.file import save_policy
from mdpo_rddl.session.report.race_figure import draw_race
from mdpo_rddl.session.report.run_folder import POLICY
from mdpo_rddl.session.report.summary import optimum_figures
from mdpo_rddl.session.report.training import write_history

if TYPE_CHECKING:
    from mdpo_rddl.auto import RaceOutcome

COLUMNS = ("seconds", "arm", "candidate", "mean_return", "error", "became_incumbent")


def race_figures(outcome: "RaceOutcome") -> dict[str, Any]:
    """How the race went, on what; `train_seconds` is what compilation has left of the time."""
    ended = "time_budget_reached" if outcome.optimum is None else "optimum_proven"
    return {
        **optimum_figures(outcome.policy),
        "status": "interrupted" if outcome.interrupted else ended,
        "train_seconds": max(0.0, outcome.seconds - outcome.compile_seconds),
        "compile_seconds": outcome.compile_seconds,
        "device": str(fitting_device(outcome.policy.problem) or current_device()),
        "versions": package_versions(),
        "auto": outcome.diagnostics(),
    }


def write_race(folder: Path, outcome: "RaceOutcome", summary: Mapping[str, Any]) -> None:
    """Writes the policy, the candidates and their picture, and the noise if the result used it.

    Args:
      folder: where.
      outcome: of the race.
      summary: with `race_figures`; what the pictures are made of.
    """
    save_policy(folder / POLICY, outcome.policy.to_saved())
    race = summary["auto"]
    head = (
        f"{summary['label']} (H = {summary['horizon']}), by {race['arm']}, seed {summary['seed']}"
    )
    with (folder / "candidates.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(race["candidates"])
    draw_race(folder / "learning_curve.png", race, head)
    log = outcome.noise_log
    if log is not None and log.sigma is not None:
        write_history(folder, log.records, log.sigma, head)
