"""Rows of planners on tasks, as `benchmarks.tasks.trial` writes them, with given returns."""

import json

from benchmarks.common.records import Records
from benchmarks.tasks.trial import COLUMNS, KEYS


def row_of(columns=COLUMNS, **values):
    """What follows the keys: a row that went well but for the given values."""
    return tuple({"status": "ok", **values}.get(name, "") for name in columns[len(KEYS) :])


def records_of(path, *rows):
    """Records of (problem, planner, returns) on first instances, in a folder."""
    records = Records(path / "rows.csv", COLUMNS, KEYS)
    for problem, planner, returns in rows:
        mean = sum(returns) / len(returns)
        figures = row_of(mean=mean, returns=json.dumps(returns))
        records.add(problem, "1", planner, 0, *figures)
    return records
