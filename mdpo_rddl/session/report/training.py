"""What one training leaves behind beside its summary."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.planner.training.training import Record, TrainingResult
from mdpo_rddl.policy.file import save_policy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.session.report.figures import draw_learning_curve, draw_noise
from mdpo_rddl.session.report.run_folder import POLICY
from mdpo_rddl.session.report.summary import title


def write_training(
    folder: Path, result: TrainingResult, policy: Policy, summary: Mapping[str, Any]
) -> None:
    """Writes the policy, the history, the noise and their pictures.

    Args:
      folder: where.
      result: of the training.
      policy: that it found.
      summary: what the pictures' titles are made of.
    """
    save_policy(folder / POLICY, policy.to_saved())
    head = title(summary)
    draw_learning_curve(folder / "learning_curve.png", result.history, result.best_iteration, head)
    write_history(folder, result.history, result.sigma, head)


def write_history(folder: Path, history: Sequence[Record], sigma: np.ndarray, head: str) -> None:
    """Writes the recorded iterations and the noise, and draws it.

    Args:
      folder: where.
      history: the recorded iterations.
      sigma: scale of the noise per recorded iteration and step [recorded, H].
      head: the picture's title.
    """
    with (folder / "history.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Record._fields)
        writer.writerows(history)
    np.save(folder / "noise.npy", sigma)
    draw_noise(folder / "noise.png", sigma, [record.iteration for record in history], head)
