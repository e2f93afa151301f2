"""How fast iterations are, as a ratio to JaxPlan's own loop, both in one process in turn."""

import itertools
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from benchmarks.common.records import Records
from benchmarks.common.settings import load_setting, setting_files
from benchmarks.speed.bare import BOTH_GRADIENTS, compile_part
from benchmarks.speed.rates import ITERATIONS_PER_CALL, in_turn, rates, rates_of_calls
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.planner.build import build_baseline, build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

KEYS = ("setting", "noise", "seeds", "test_every", "against")
COLUMNS = (*KEYS, "theirs", "ours", "ratio", "goal")
TEST_BATCH = 20
# iterations on their own, hardly a test among them
_RARELY = 10 * ITERATIONS_PER_CALL
JAXPLAN, BARE, COMMAND = "JaxPlan", "its two gradients", "JaxPlan in a fresh process"


class Case(NamedTuple):
    """One comparison.

    Attributes:
      noise: "none" or "adaptive".
      seeds: policies trained side by side, in both planners.
      test_every: our iterations from one test to the next; JaxPlan tests after each.
      against: `JAXPLAN` or `BARE`.
      goal: the least ratio that was asked for.
    """

    noise: str
    seeds: int
    test_every: int
    against: str
    goal: float


CASES = (
    Case("none", 1, ITERATIONS_PER_CALL, JAXPLAN, 4.0),
    Case("adaptive", 1, ITERATIONS_PER_CALL, JAXPLAN, 2.0),
    Case("adaptive", 20, ITERATIONS_PER_CALL, JAXPLAN, 1.5),
    Case("none", 1, 1, JAXPLAN, 1.2),
    Case("adaptive", 1, 1, JAXPLAN, 1.0),
    Case("adaptive", 20, 1, JAXPLAN, 1.0),
    Case("adaptive", 20, _RARELY, BARE, 0.9),
)
_COMMAND_GOAL = 2.0


def run_speed(
    out: Path, settings: Iterable[str], turns: int, seconds: float, command_turns: int
) -> Records:
    """Measures every case on every setting, and the whole command on hvac10.

    Rows that `out/speed.csv` holds already are skipped.

    Args:
      out: results folder.
      settings: names of settings.
      turns: measurements of each side, one after the other: A B A B.
      seconds: of each measurement.
      command_turns: the same for the command.
    """
    devices = len(jax.devices())
    conditions = {"turns": turns, "seconds": seconds, "devices": devices, "versions": versions()}
    records = Records(out / "speed.csv", COLUMNS, KEYS, conditions)
    for setting, case in itertools.product(settings, CASES):
        if records.has(setting, *case[:4]):
            continue
        sides = _theirs(setting, case), _ours(setting, case)
        theirs, ours = in_turn([side(seconds) for side in sides], turns)
        records.add(setting, *case[:4], theirs, ours, ours / theirs, case.goal)
        logger.info("%s %s: ratio %.2f", setting, case, ours / theirs)
    key = ("hvac10", "adaptive", 1, 10, COMMAND)
    if command_turns and not records.has(*key):
        theirs, ours = _commands_in_turn(command_turns)
        records.add(*key, theirs, ours, theirs / ours, _COMMAND_GOAL)
        logger.info("the whole command: ratio %.2f", theirs / ours)
    return records


def preset_for(
    setting: str, noise: str, seeds: int, test_every: int
) -> tuple[Problem, PlannerConfig]:
    """A setting and the paper preset as it is timed.

    Args:
      setting: its name.
      noise: "none" or "adaptive".
      seeds: policies trained side by side.
      test_every: iterations from one test to the next.
    """
    problem = load_setting(setting)
    config = PRESETS["paper"](problem.domain_name)
    per_call = max(ITERATIONS_PER_CALL, test_every)
    sizes = {"iterations_per_call": per_call, "test_every": test_every}
    config = config.with_values("MDPO", **sizes)
    if noise == "none":
        config = config.with_section("Noise", {"method": "NoNoise"})
    values = {"parallel_updates": seeds, "batch_size_test": TEST_BATCH}
    return problem, config.with_values("Planner", **values)


def _theirs(setting: str, case: Case) -> Callable[[float], Iterator[float]]:
    problem, config = preset_for(setting, *case[:3])
    if case.against == BARE:
        planner = build_planner(problem, config).planner
        gradients = compile_part(planner, jax.random.PRNGKey(0), BOTH_GRADIENTS)
        return lambda seconds: rates_of_calls(gradients, case.seeds, seconds, case.test_every)
    jaxplan = build_baseline(problem, config)
    return lambda seconds: rates(jaxplan, case.seeds, seconds)


def _ours(setting: str, case: Case) -> Callable[[float], Iterator[float]]:
    built = build_planner(*preset_for(setting, *case[:3]))
    return lambda seconds: rates(built, case.seeds, seconds)


# JaxPlan's classes and nothing of ours, from the start of Python to the trained policy
_FRESH_JAXPLAN = """
import sys
import jax, optax, pyRDDLGym
from pyRDDLGym_jax.core.planner import JaxBackpropPlanner, JaxDeepReactivePolicy

env = pyRDDLGym.make(sys.argv[1], sys.argv[2], vectorized=True)
planner = JaxBackpropPlanner(
    env.model,
    JaxDeepReactivePolicy(topology=[12, 12]),
    batch_size_train=1,
    batch_size_test=20,
    optimizer=optax.rmsprop,
    optimizer_kwargs={"learning_rate": 0.01, "decay": 0.99},
    pgpe=None,
)
key = jax.random.PRNGKey(0)
planner.optimize(
    key=key, epochs=3000, train_seconds=1e9, print_summary=False, print_progress=False
)
"""


def _commands_in_turn(turns: int) -> tuple[float, float]:
    """Median seconds of JaxPlan's process and of ours, which has run on the machine before."""
    domain, instance = setting_files("hvac10")
    with tempfile.TemporaryDirectory() as folder:
        ours = [sys.executable, "-m", "mdpo_rddl.cli.plan", domain, instance]
        ours += ["--iterations", "3000", "--quiet", "--out", str(Path(folder) / "run")]
        theirs = [sys.executable, "-c", _FRESH_JAXPLAN, domain, instance]
        _seconds_of(ours)
        seconds = [(_seconds_of(theirs), _seconds_of(ours)) for _ in range(turns)]
    return tuple(np.median(np.array(seconds), axis=0).tolist())


def _seconds_of(command: Sequence[str]) -> float:
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - started


def speed_table(records: Records) -> str:
    """Markdown: per case both rates, their ratio and the ratio asked for."""
    lines = [
        "| setting | noise | seeds | tests every | against | its rate | ours | ratio | asked for |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in records.rows:
        theirs, ours = float(row["theirs"]), float(row["ours"])
        if row["against"] == COMMAND:
            rates = [f"{theirs:.1f} s", f"{ours:.1f} s"]
        else:
            rates = [f"{theirs:,.0f}", f"{ours:,.0f}"]
        cells = [row["setting"], row["noise"], row["seeds"], row["test_every"], row["against"]]
        cells += [*rates, f"**{float(row['ratio']):.2f}**", f"{float(row['goal']):.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", "Rates are iterations a second, times the seeds. JaxPlan tests after each one."]
    return "\n".join(lines) + "\n"
