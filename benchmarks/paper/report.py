"""The report on a results folder, made from its files alone."""

import json
from pathlib import Path

import numpy as np

from benchmarks.common.names import SETTINGS
from benchmarks.paper.cells import load_played, load_trained
from benchmarks.paper.figures import draw_landscapes, draw_learning_curves, draw_noise
from benchmarks.paper.landscape import load_landscape
from benchmarks.paper.names import METHODS
from benchmarks.paper.tables import (
    Key,
    Measured,
    as_csv,
    as_json,
    as_markdown,
    make_overall,
    make_rows,
)
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import write_atomically


def write_report(out: Path) -> str:
    """Writes table, per-seed data and figures of all cells that are complete.

    Args:
      out: a results folder of `run_paper`.

    Returns:
      The table in Markdown.

    Raises:
      InputError: if there is no complete cell, or a file is something else.
    """
    measured = load_measured(out)
    if not measured:
        raise InputError(f"{out}: holds no results of python -m benchmarks paper")
    rows, overall = make_rows(measured), make_overall(measured)
    table = as_markdown(rows, overall)
    write_atomically(out / "table.json", json.dumps(as_json(rows, overall), indent=1) + "\n")
    write_atomically(out / "runs.csv", as_csv(measured))
    write_atomically(out / "table.md", table)
    draw_learning_curves(out / "figure2_iterations.png", measured, over_time=False)
    draw_learning_curves(out / "figure2_seconds.png", measured, over_time=True)
    draw_noise(out / "figure3.png", measured)
    landscape = load_landscape(out)
    if landscape is not None:
        draw_landscapes(out / "figure1.png", landscape)
    return table


def load_measured(out: Path) -> dict[Key, Measured]:
    """The complete cells of a results folder, in the paper's order."""
    found = {}
    for setting in SETTINGS:
        for method in METHODS:
            measured = _load(out / "cells" / f"{setting}_{method}")
            if measured is not None:
                found[setting, method] = measured
    return found


def _load(folder: Path) -> Measured | None:
    trained = load_trained(folder)
    if trained is None:
        return None
    played, seconds = load_played(folder)
    if any(seed not in played for seed in range(trained.seeds)):
        return None
    returns = np.stack([played[seed] for seed in range(trained.seeds)])
    return Measured(trained, returns, seconds)
