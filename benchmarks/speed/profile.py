"""Where the time of an iteration goes: its parts on their own, and what is left."""

import itertools
import logging
from collections.abc import Iterable
from pathlib import Path

import jax

from benchmarks.common.records import Records
from benchmarks.speed.bare import PARTS, compile_part
from benchmarks.speed.rates import ITERATIONS_PER_CALL, in_turn, rates, rates_of_calls
from benchmarks.speed.speed import preset_for
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.planner.build import build_baseline, build_planner

logger = logging.getLogger(__name__)

KEYS = ("setting", "seeds", "part")
COLUMNS = (*KEYS, "microseconds")
SEEDS = (1, 20)
WHOLE, TESTED, DISPATCHED = "iteration", "with a test each", "and one call each"
JAXPLAN = "JaxPlan's iteration"
MEASURED = (*PARTS, WHOLE, TESTED, DISPATCHED, JAXPLAN)


def run_profile(out: Path, settings: Iterable[str], turns: int, seconds: float) -> Records:
    """Times adaptive iterations, their parts, and JaxPlan's iterations, in turn.

    Rows that `out/profile.csv` holds already are skipped.

    Args:
      out: results folder.
      settings: names of settings.
      turns: measurements of each, one after the other.
      seconds: of each measurement.
    """
    devices = len(jax.devices())
    conditions = {"turns": turns, "seconds": seconds, "devices": devices, "versions": versions()}
    records = Records(out / "profile.csv", COLUMNS, KEYS, conditions)
    for setting, seeds in itertools.product(settings, SEEDS):
        if all(records.has(setting, seeds, part) for part in MEASURED):
            continue
        found = _microseconds(setting, seeds, turns, seconds)
        for part, microseconds in found.items():
            if not records.has(setting, seeds, part):
                records.add(setting, seeds, part, microseconds)
        logger.info("%s, %d seeds: %.0f us an iteration", setting, seeds, found[WHOLE])
    return records


def _microseconds(setting: str, seeds: int, turns: int, seconds: float) -> dict[str, float]:
    """Of one iteration of all seeds, per entry of `MEASURED`."""
    problem, config = preset_for(setting, "adaptive", seeds, ITERATIONS_PER_CALL)
    built = build_planner(problem, config)
    tested = build_planner(problem, config.with_values("MDPO", test_every=1))
    single = {"iterations_per_call": 1, "test_every": 1}
    dispatched = build_planner(problem, config.with_values("MDPO", **single))
    jaxplan = build_baseline(problem, config)
    key = jax.random.PRNGKey(0)
    sides = [
        *(rates_of_calls(compile_part(built.planner, key, part), 1, seconds) for part in PARTS),
        *(rates(whole, 1, seconds) for whole in (built, tested, dispatched, jaxplan)),
    ]
    return {p: 1e6 / rate for p, rate in zip(MEASURED, in_turn(sides, turns), strict=True)}


def profile_table(records: Records) -> str:
    """Markdown: per setting and number of seeds what an iteration is made of."""
    names = (
        "analysis gradient",
        "update gradient",
        "noise",
        "optimiser, log",
        "**iteration**",
        "a test",
        "dispatch",
        JAXPLAN,
    )
    lines = [
        "| setting | seeds | " + " | ".join(names) + " |",
        "|" + "---|" * (len(names) + 2),
    ]
    found = {tuple(row[k] for k in KEYS): float(row["microseconds"]) for row in records.rows}
    for setting, seeds in dict.fromkeys((row["setting"], row["seeds"]) for row in records.rows):
        times = [found[setting, seeds, part] for part in MEASURED]
        both, analysis, update, scale, draw, whole, tested, dispatched, jaxplan = times
        shares = [analysis, update, scale + draw, whole - both - scale - draw, whole]
        shares += [tested - whole, dispatched - tested, jaxplan]
        cells = [setting, seeds, *(f"{share:,.0f}" for share in shares)]
        lines.append("| " + " | ".join(cells) + " |")
    lines += [
        "",
        "Microseconds for all seeds together. Gradients and noise were timed on their own, the "
        "rest are differences: what the iteration takes beyond both gradients and the noise, a "
        f"test after each iteration instead of after {ITERATIONS_PER_CALL}, a call for each "
        "tested iteration. JaxPlan's iteration differentiates one rollout, and tests.",
    ]
    return "\n".join(lines) + "\n"
