"""What the cells say: where noise pays, where it harms, and what it costs."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.bench.noise_value.cells import OK, read
from mdpo_rddl.bench.noise_value.figures import draw_curves, draw_strips
from mdpo_rddl.bench.noise_value.methods import METHODS, NONE
from mdpo_rddl.bench.noise_value.statistics import (
    LEVEL,
    holm,
    mean_interval,
    normalised,
    paired_p,
)

Results = Mapping[str, dict[str, Any]]


class Task(NamedTuple):
    """What all methods were measured on."""

    problem: str
    instance: str
    plan: str
    configuration: str


def load_results(out: Path) -> dict[Task, dict[str, dict[str, Any]]]:
    """The finished cells of a folder, per task and method, where no noise is among them.

    Raises:
      InputError: if a file is not a cell's.
    """
    results: dict[Task, dict[str, dict[str, Any]]] = {}
    for path in sorted((out / "cells").glob("*.json")):
        kept = read(path)
        if kept["status"] == OK:
            conditions = kept["conditions"]
            task = Task(*(conditions[name] for name in Task._fields))
            results.setdefault(task, {})[conditions["method"]] = kept
    return {task: found for task, found in results.items() if NONE in found}


def write_report(out: Path) -> str:
    """Writes the figures; returns the tables as Markdown.

    Raises:
      InputError: if a file is not a cell's.
    """
    results = load_results(out)
    scores = {task: _scores(found) for task, found in results.items()}
    methods = [name for name in METHODS if any(name in found for found in results.values())]
    rows = {method: _compared(results, method) for method in methods if method != NONE}
    lines = [*_summary(results, scores, methods, rows), "", *_details(results, methods, rows)]
    failed = [path.stem for path in _failed(out)]
    if failed:
        lines += ["", f"Not measured: {', '.join(failed)}."]
    if results:
        draw_strips(out / "strips.png", scores, [m for m in methods if m != NONE])
        draw_curves(out / "curves.png", results, scores)
    return "\n".join(lines) + "\n"


def _failed(out: Path) -> Iterable[Path]:
    return [path for path in sorted((out / "cells").glob("*.json")) if read(path)["status"] != OK]


def _scores(found: Results) -> dict[str, np.ndarray]:
    returns = {name: np.asarray(kept["returns"], float) for name, kept in found.items()}
    return normalised(returns, float(found[NONE]["noop"]))


def _compared(results: Mapping[Task, Results], method: str) -> dict[Task, tuple[float, float]]:
    """Per task the mean lead over no noise, and its p value after Holm over all tasks."""
    tasks = [task for task, found in results.items() if method in found]
    pairs = [(results[t][method]["returns"], results[t][NONE]["returns"]) for t in tasks]
    leads = [float(np.mean(ours) - np.mean(theirs)) for ours, theirs in pairs]
    adjusted = holm([paired_p(np.asarray(ours), np.asarray(theirs)) for ours, theirs in pairs])
    return {t: (lead, float(p)) for t, lead, p in zip(tasks, leads, adjusted, strict=True)}


def _summary(
    results: Mapping[Task, Results],
    scores: Mapping[Task, Mapping[str, np.ndarray]],
    methods: Iterable[str],
    rows: Mapping[str, Mapping[Task, tuple[float, float]]],
) -> list[str]:
    lines = [
        "| method | tasks | mean score (95% interval) | better than none | worse | time |",
        "|---|---|---|---|---|---|",
    ]
    for method in methods:
        found = [s[method] for s in scores.values() if method in s]
        mean, low, high = mean_interval(found)
        compared = rows.get(method, {}).values()
        better = sum(lead > 0 and p < LEVEL for lead, p in compared)
        worse = sum(lead < 0 and p < LEVEL for lead, p in compared)
        counts = ["", ""] if method == NONE else [str(better), str(worse)]
        score = f"{mean:.3f} [{low:.3f}, {high:.3f}]"
        cells = [method, str(len(found)), score, *counts, f"{_cost(results, method):.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    note = "Better and worse: p < 0.05, Student's paired t-test by seed, Holm over the tasks. "
    note += "Time: of training, median over the tasks, as a multiple of that without noise."
    return [*lines, "", note]


def _cost(results: Mapping[Task, Results], method: str) -> float:
    ratios = [
        np.median(found[method]["train_seconds"]) / np.median(found[NONE]["train_seconds"])
        for found in results.values()
        if method in found
    ]
    return float(np.median(ratios))


def _details(
    results: Mapping[Task, Results],
    methods: Iterable[str],
    rows: Mapping[str, Mapping[Task, tuple[float, float]]],
) -> list[str]:
    """A line for each task; a star marks what differs significantly from no noise."""
    methods = list(methods)
    heads = ["problem", "instance", "plan", "configuration", "no-op", *methods]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for task, found in results.items():
        cells = [*task, _number(float(found[NONE]["noop"]))]
        for method in methods:
            if method not in found:
                cells.append("")
                continue
            star = ""
            if method != NONE and rows[method][task][1] < LEVEL:
                star = " \\*"
            cells.append(_number(float(np.mean(found[method]["returns"]))) + star)
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
