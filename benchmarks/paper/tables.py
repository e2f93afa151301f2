"""The paper's table beside ours, cell by cell."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.common.names import SETTINGS
from benchmarks.common.table1 import TABLE
from benchmarks.paper.cells import Trained
from benchmarks.paper.iterates import LAST
from benchmarks.paper.names import ADAPTIVE, METHODS, PPO
from benchmarks.paper.statistics import (
    Interval,
    bootstrap_interval,
    interquartile_mean,
    paired_p,
    stratified_interval,
    within_seed_interval,
)

Key = tuple[str, str]
# what 32 bit floating-point numbers lose over a rollout
_ROUNDING = 1e-4


@dataclass(frozen=True)
class Measured:
    """A finished cell.

    Attributes:
      trained: training and evaluation on the exact compiled model.
      played: returns of the last iterates on the numpy environment [S, episodes].
      play_seconds: how long that took.
    """

    trained: Trained
    played: np.ndarray
    play_seconds: float

    @property
    def scores(self) -> np.ndarray:
        """The paper's figure for each seed: mean over the last iterates [S]."""
        return self.trained.returns[:, -LAST:].mean(axis=1)


@dataclass(frozen=True)
class Row:
    """One cell of the table, with all that is said of it.

    Attributes:
      setting, method, seeds: of the cell.
      mean, std: over the seeds (n - 1).
      paper_mean, paper_std: Table 1's.
      deviations: by how many of the larger of the two deviations ours is above the paper's.
      iqm, iqm_ci95: interquartile mean over the seeds, and its bootstrap interval.
      adaptive_p: p value that adaptive is better, seed by seed; None for adaptive itself.
      compiled, compiled_ci95: the last iterates on the exact compiled model.
      numpy, numpy_ci95: the same policies on the numpy environment.
      agree: whether these two intervals overlap.
      seconds: of compiling, training, evaluating and playing.
    """

    setting: str
    method: str
    seeds: int
    mean: float
    std: float
    paper_mean: float
    paper_std: float
    deviations: float
    iqm: float
    iqm_ci95: Interval
    adaptive_p: float | None
    compiled: float
    compiled_ci95: Interval
    numpy: float
    numpy_ci95: Interval
    agree: bool
    seconds: Mapping[str, float]


def make_rows(measured: Mapping[Key, Measured]) -> list[Row]:
    """The rows of all cells that there are, in the paper's order."""
    keys = [(s, m) for s in SETTINGS for m in METHODS if (s, m) in measured]
    return [_row(key, measured[key], measured.get((key[0], ADAPTIVE))) for key in keys]


def _row(key: Key, cell: Measured, adaptive: Measured | None) -> Row:
    scores, paper = cell.scores, TABLE[key]
    std = float(scores.std(ddof=1)) if len(scores) > 1 else 0.0
    p = None
    if adaptive is not None and key[1] != ADAPTIVE:
        common = min(len(scores), len(adaptive.scores))
        p = paired_p(adaptive.scores[:common], scores[:common])
    compiled = within_seed_interval(cell.trained.last_returns)
    played = within_seed_interval(cell.played)
    tolerance = _ROUNDING * abs(float(cell.played.mean()))
    return Row(
        setting=key[0],
        method=key[1],
        seeds=len(scores),
        mean=float(scores.mean()),
        std=std,
        paper_mean=paper.mean,
        paper_std=paper.std,
        deviations=(float(scores.mean()) - paper.mean) / max(std, paper.std, 1e-9),
        iqm=float(interquartile_mean(scores)),
        iqm_ci95=bootstrap_interval(scores),
        adaptive_p=p,
        compiled=float(cell.trained.last_returns.mean()),
        compiled_ci95=compiled,
        numpy=float(cell.played.mean()),
        numpy_ci95=played,
        agree=compiled.overlaps(played, tolerance),
        seconds={**cell.trained.seconds, "play": round(cell.play_seconds, 2)},
    )


@dataclass(frozen=True)
class Overall:
    """One method over all settings, on a scale where the paper's PPO is 0 and its adaptive 1.

    Attributes:
      method: its name.
      settings, seeds: how many of each.
      iqm, iqm_ci95: interquartile mean of all scores, and its stratified bootstrap interval.
    """

    method: str
    settings: int
    seeds: int
    iqm: float
    iqm_ci95: Interval


def make_overall(measured: Mapping[Key, Measured]) -> list[Overall]:
    """Every method that has been measured on all settings that any has."""
    settings = [s for s in SETTINGS if any(s == setting for setting, _ in measured)]
    found = []
    for method in METHODS:
        if all((setting, method) in measured for setting in settings):
            seeds = min(measured[setting, method].trained.seeds for setting in settings)
            scores = [_scaled(s, measured[s, method].scores[:seeds]) for s in settings]
            overall = stratified_interval(np.stack(scores))
            found.append(Overall(method, len(settings), seeds, *overall))
    return found


def _scaled(setting: str, scores: np.ndarray) -> np.ndarray:
    low, high = TABLE[setting, PPO].mean, TABLE[setting, ADAPTIVE].mean
    return (scores - low) / (high - low)


def as_json(rows: Sequence[Row], overall: Sequence[Overall]) -> dict[str, Any]:
    """Cells and methods as JSON can hold them; what is not a number is null."""
    parts: dict[str, Sequence[Any]] = {"cells": rows, "methods": overall}
    return {
        name: [{key: _plain(value) for key, value in asdict(item).items()} for item in items]
        for name, items in parts.items()
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Interval | tuple | list):
        return [_plain(part) for part in value]
    if isinstance(value, float):
        return round(value, 6) if np.isfinite(value) else None
    return value


def as_csv(measured: Mapping[Key, Measured]) -> str:
    """A line per setting, method and seed: its figure, and its last iterate's mean returns."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["setting", "method", "seed", "last_5", "last_compiled", "last_numpy"])
    for (setting, method), cell in measured.items():
        for seed, score in enumerate(cell.scores):
            means = cell.trained.last_returns[seed].mean(), cell.played[seed].mean()
            figures = [f"{value:.2f}" for value in (score, *means)]
            writer.writerow([setting, method, seed, *figures])
    return text.getvalue()


def as_markdown(rows: Sequence[Row], overall: Sequence[Overall]) -> str:
    """The comparison, and under it how sure it is and what it cost."""
    comparison = _table(
        ["setting", "method", "seeds", "ours", "the paper's", "difference / deviation"],
        [
            [
                row.setting,
                row.method,
                str(row.seeds),
                f"{row.mean:,.0f} ± {row.std:,.0f}",
                f"{row.paper_mean:,.0f} ± {row.paper_std:,.0f}",
                f"{row.deviations:+.1f}",
            ]
            for row in rows
        ],
    )
    certainty = _table(
        [
            "setting",
            "method",
            "interquartile mean [95%]",
            "p, adaptive better",
            "last iterate, compiled model [95%]",
            "the same, numpy environment [95%]",
            "agree",
        ],
        [
            [
                row.setting,
                row.method,
                _with_interval(row.iqm, row.iqm_ci95),
                "" if row.adaptive_p is None else f"{row.adaptive_p:.2g}",
                _with_interval(row.compiled, row.compiled_ci95),
                _with_interval(row.numpy, row.numpy_ci95),
                "yes" if row.agree else "no",
            ]
            for row in rows
        ],
    )
    summary = _table(
        ["method", "settings", "seeds", "interquartile mean [95%]; the paper's: ppo 0, adaptive 1"],
        [
            [
                method.method,
                str(method.settings),
                str(method.seeds),
                f"{method.iqm:.3f} [{method.iqm_ci95.low:.3f}, {method.iqm_ci95.high:.3f}]",
            ]
            for method in overall
        ],
    )
    return "\n".join([comparison, certainty, summary, _times(rows)])


def _times(rows: Sequence[Row]) -> str:
    parts = ("compile", "train", "evaluate", "play")
    lines = []
    for method in METHODS:
        found = [row.seconds for row in rows if row.method == method]
        if found:
            seconds = [sum(s[part] for s in found) for part in parts]
            lines.append([method, *(f"{s:,.0f}" for s in (*seconds, sum(seconds)))])
    total = [sum(row.seconds[part] for row in rows) for part in parts]
    lines.append(["all", *(f"{s:,.0f}" for s in (*total, sum(total)))])
    return _table(["seconds", *parts, "in all"], lines)


def _with_interval(value: float, interval: Interval) -> str:
    return f"{value:,.0f} [{interval.low:,.0f}, {interval.high:,.0f}]"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(cells) + " |" for cells in (header, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(header), *lines[1:]]) + "\n"
