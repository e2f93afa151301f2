"""How the time and the memory of an iteration grow with the problem and the restarts."""

import logging
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
from matplotlib.figure import Figure

from benchmarks.common.generate import hvac_instance, reservoir_instance
from benchmarks.common.records import Records
from benchmarks.common.settings import load_setting
from benchmarks.speed.names import AXES
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded
from mdpo_rddl.machine.jax_setup import use_all_cores
from mdpo_rddl.machine.memory import peak_mb
from mdpo_rddl.machine.pictures import write_picture
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.problem.load import Problem, load_problem
from mdpo_rddl.problem.shipped import shipped_files

logger = logging.getLogger(__name__)

KEYS = ("axis", "size")
COLUMNS = (*KEYS, "status", "milliseconds", "compile_seconds", "peak_mb", "device")

_DESCRIPTIONS = {
    "horizon": "horizon, reservoir30 with 20 restarts",
    "reservoirs": "reservoirs, horizon 120, 1 restart",
    "zones": "zones and heaters each, horizon 120, 1 restart",
    "restarts": "restarts, reservoir30, horizon 120",
}
# the setting whose domain it is of
_GENERATORS: dict[str, tuple[str, Callable[[int, int], str]]] = {
    "reservoirs": ("reservoir30", reservoir_instance),
    "zones": ("hvac10", hvac_instance),
}
_ITERATIONS = 5


@dataclass(frozen=True)
class Point:
    """What to measure.

    Attributes:
      axis: a key of `AXES`.
      size: the value on it.
      seconds: of measuring, compilation not counted.
    """

    axis: str
    size: int
    seconds: float


def run_growth(out: Path, axes: Iterable[str], seconds: float, limits: Limits) -> Records:
    """Times adaptive iterations of the paper preset at every size, each in a fresh process.

    Rows that `out/growth.csv` holds already are skipped.

    Args:
      out: results folder; `growth.png` is drawn there.
      axes: keys of `AXES`.
      seconds: of measuring each.
      limits: for each.
    """
    conditions = {"seconds": seconds, "versions": versions()}
    records = Records(out / "growth.csv", COLUMNS, KEYS, conditions)
    for axis in axes:
        for size in AXES[axis]:
            if records.has(axis, size):
                continue
            for _, outcome in run_guarded(measure, [Point(axis, size, seconds)], limits):
                row = {"status": outcome.cause} if isinstance(outcome, ProcessFailure) else outcome
                records.add(axis, size, *(row.get(name, "") for name in COLUMNS[len(KEYS) :]))
                logger.info("%s %d: %s", axis, size, row)
    draw_growth(records, out / "growth.png")
    return records


def measure(point: Point) -> dict[str, Any]:
    """The row of one size; an error becomes its status."""
    use_all_cores()
    try:
        return _measure(point)
    except Exception as error:  # whatever it is, it is the finding
        return {"status": one_line_cause(error)}


def _measure(point: Point) -> dict[str, Any]:
    problem = _problem(point)
    restarts = {"horizon": 20, "restarts": point.size}.get(point.axis, 1)
    config = PRESETS["paper"](problem.domain_name)
    config = config.with_values("Planner", parallel_updates=restarts, batch_size_test=1)
    config = config.with_values("MDPO", iterations_per_call=_ITERATIONS, test_every=_ITERATIONS)
    built = build_planner(problem, config)
    callbacks = built.callbacks(jax.random.PRNGKey(0), Budget(10**8, 1e300))
    started = time.perf_counter()
    next(callbacks)
    compile_seconds = time.perf_counter() - started
    calls, started = 0, time.perf_counter()
    while calls < 2 or time.perf_counter() - started < point.seconds:
        next(callbacks)
        calls += 1
    seconds = (time.perf_counter() - started) / (calls * _ITERATIONS)
    return {
        "status": "ok",
        "milliseconds": 1000 * seconds,
        "compile_seconds": compile_seconds,
        "peak_mb": peak_mb(),
        "device": f"{len(jax.devices())} {jax.devices()[0].device_kind}",
    }


def _problem(point: Point) -> Problem:
    if point.axis not in _GENERATORS:
        setting = load_setting("reservoir30")
        horizon = point.size if point.axis == "horizon" else None
        return load_problem(str(setting.domain_path), str(setting.instance_path), horizon)
    setting_name, generate = _GENERATORS[point.axis]
    domain, _ = shipped_files(setting_name)
    with tempfile.TemporaryDirectory() as folder:
        instance = Path(folder) / "generated.rddl"
        instance.write_text(generate(point.size, 0), encoding="utf-8")
        return load_problem(str(domain), str(instance))


def growth_table(records: Records) -> str:
    """Markdown: per axis and size the time and the memory, and how both grew from the first."""
    lines = [
        "| axis | size | ms an iteration | grew | size grew | peak memory, MB | compilation, s |",
        "|---|---|---|---|---|---|---|",
    ]
    for axis in AXES:
        rows = [row for row in records.rows if row["axis"] == axis]
        rows.sort(key=lambda row: int(row["size"]))
        for row in rows:
            if row["status"] != "ok":
                lines.append(f"| {axis} | {row['size']} | {row['status']} | | | | |")
                continue
            first = rows[0]
            grew = ["", ""]
            if row is not first and first["status"] == "ok":
                ratios = [
                    float(row[name]) / float(first[name]) for name in ("milliseconds", "size")
                ]
                grew = [f"x {ratio:.1f}" for ratio in ratios]
            cells = [
                axis,
                row["size"],
                f"{float(row['milliseconds']):.2f}",
                *grew,
                f"{float(row['peak_mb']):.0f}",
                f"{float(row['compile_seconds']):.0f}",
            ]
            lines.append("| " + " | ".join(cells) + " |")
    devices = sorted({row["device"] for row in records.rows if row["device"]})
    lines += ["", f"Devices: {', '.join(devices)}. Memory is that of the whole process."]
    return "\n".join(lines) + "\n"


def draw_growth(records: Records, path: Path) -> None:
    """Draws time and memory against each size, with a line for linear growth."""
    figure = Figure(figsize=(14, 6), layout="constrained")
    axes = figure.subplots(2, len(AXES))
    for column, axis in enumerate(AXES):
        rows = [row for row in records.rows if row["axis"] == axis and row["status"] == "ok"]
        rows.sort(key=lambda row: int(row["size"]))
        sizes = [int(row["size"]) for row in rows]
        for ax, name, label in zip(
            axes[:, column],
            ("milliseconds", "peak_mb"),
            ("ms an iteration", "peak memory of the process, MB"),
            strict=True,
        ):
            values = [float(row[name]) for row in rows]
            ax.loglog(sizes, values, "o-", color="C0", label="measured")
            if values:
                linear = [values[0] * size / sizes[0] for size in sizes]
                ax.loglog(sizes, linear, ":", color="0.5", label="linear from the smallest")
            ax.set_xlabel(_DESCRIPTIONS[axis])
            ax.set_xticks(sizes, [str(size) for size in sizes])
            ax.minorticks_off()
            ax.grid(alpha=0.3)
            if column == 0:
                ax.set_ylabel(label)
                ax.legend()
    write_picture(figure, path, dpi=130)
