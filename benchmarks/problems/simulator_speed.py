"""How many steps a second the simulator makes, beside pyRDDLGym's and the compiled model.

CPU time of one process on one core. All play the same random actions in rollouts from the initial
state. The compiled model is JaxPlan's exact one as a program of `jax.jit` and `jax.vmap`; it is
ready after its first call, the simulator when it is made. The instance is the middle one of each
problem's.
"""

import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from matplotlib.figure import Figure
from rddlrepository.core.manager import RDDLRepoManager

from benchmarks.common.generate import reservoir_instance
from benchmarks.common.records import Records
from benchmarks.problems.agreement import compile_sequences, make_planner
from benchmarks.problems.each import KEYS, add_rows
from benchmarks.problems.simulator_law import random_actions
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.memory import peak_mb
from mdpo_rddl.machine.pictures import write_picture
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.problem.load import Problem, load_problem, make_environment
from mdpo_rddl.problem.shipped import shipped_files
from mdpo_rddl.simulator.simulator import Simulator

REPLICAS = (1, 128, 1024)
_RATES = ("environment", *(f"simulator_{count}" for count in REPLICAS), "compiled_1024")
_COLUMNS = ("status", "cause", "made_seconds", *_RATES, "compiled_ready_seconds", "peak_mb")
# a step of pyRDDLGym's that takes so long is array work, of which there is as much here
_SLOW_STEP_SECONDS = 0.05
OBJECTS = (10, 30, 100, 300, 1000)
GROWN_REPLICAS = (1, 10, 100, 1000, 10_000, 100_000)
_SECONDS, _REPEATS = 0.25, 3
_SEQUENCES = 4
_MOST_STEPS = 40


def middle_instances() -> Iterable[tuple[str, str]]:
    """Each problem of rddlrepository with the middle one of its instances."""
    manager = RDDLRepoManager()
    for name in sorted(manager.list_problems()):
        instances = sorted(manager.get_problem(name).list_instances(), key=lambda i: (len(i), i))
        yield name, instances[(len(instances) - 1) // 2]


def steps_a_second(step: Callable[[int], int]) -> float:
    """The best rate of a few repetitions of `step(number)`, which says how many steps it made."""
    best, number = 0.0, 0
    for _ in range(_REPEATS):
        made, began = 0, time.process_time()
        while time.process_time() - began < _SECONDS:
            made += step(number)
            number += 1
        best = max(best, made / (time.process_time() - began))
    return best


class Played:
    """Sequences of random actions of a problem, the same for all that are measured."""

    def __init__(self, problem: Problem) -> None:
        """Draws as many actions as the longest rollout has steps."""
        env = make_environment(problem)
        env.reset(seed=0)
        generator = np.random.default_rng(0)
        self.problem = problem
        self.horizon = min(problem.horizon, _MOST_STEPS)
        self.actions = [random_actions(env, generator) for _ in range(self.horizon)]
        self._env = env

    def of_environment(self) -> float:
        """Steps a second of pyRDDLGym's simulator, which is asked for no reset's seeds."""
        env = self._env
        env.reset(seed=0)

        def step(number: int) -> int:
            if env.done:
                env.reset()
            if env.done:  # the initial state is terminal
                return 1
            try:
                env.step(self.actions[number % self.horizon])
            except Exception:  # an action that its distributions do not bear
                env.reset()
            return 1

        return steps_a_second(step)

    def of_simulator(self, simulator: Simulator, replicas: int) -> float:
        """Steps a second of the simulator with so many replicas."""
        generator = np.random.Generator(np.random.SFC64(0))
        columns = [
            {
                name: np.ascontiguousarray(
                    np.broadcast_to(value[..., None], (*value.shape, replicas))
                )
                for name, value in actions.items()
            }
            for actions in self.actions
        ]
        state = simulator.initial(replicas)

        def step(number: int) -> int:
            nonlocal state
            if number % self.horizon == 0:
                state = simulator.initial(replicas)
            state = simulator.step(state, columns[number % self.horizon], generator).state
            return replicas

        return steps_a_second(step)

    def of_compiled(self, replicas: int) -> tuple[float, float]:
        """Steps a second of the compiled model, and the CPU seconds until its first result."""
        # what is imported is not counted
        began, problem = time.process_time(), self.problem
        play = compile_sequences(make_planner(problem), replicas)
        stacked = {
            name: np.stack([self.actions[t % self.horizon][name] for t in range(problem.horizon)])
            for name in self.actions[0]
        }
        play(jax.random.PRNGKey(0), stacked)
        ready = time.process_time() - began

        def step(number: int) -> int:
            play(jax.random.PRNGKey(number), stacked)
            return replicas * problem.horizon

        return steps_a_second(step), ready


class Item(NamedTuple):
    """A row: names of rddlrepository."""

    problem: str
    instance: str


def measure(item: Item) -> dict[str, Any]:
    """The rates on one problem; an error becomes the status and its one-line cause."""
    row: dict[str, Any] = {"status": "ok", "cause": ""}
    try:
        problem = load_problem(item.problem, item.instance)
        began = time.process_time()
        simulator = Simulator(problem)
        row["made_seconds"] = round(time.process_time() - began, 4)
        played = Played(problem)
        row["environment"] = round(played.of_environment())
        for count in REPLICAS:
            row[f"simulator_{count}"] = round(played.of_simulator(simulator, count))
        rate, ready = played.of_compiled(REPLICAS[-1])
        row["compiled_1024"], row["compiled_ready_seconds"] = round(rate), round(ready, 2)
    except Exception as error:  # whatever it is, it is the finding
        row.update(status="error", cause=one_line_cause(error))
    row["peak_mb"] = round(peak_mb())
    return row


def run_simulator(out: Path, problems: Iterable[str] | None, limits: Limits) -> Records:
    """Measures all problems, or these, with rows as they come, and then how rates grow.

    Args:
      out: results folder; rows that it holds stay; `growth.png` is drawn there.
      problems: names of rddlrepository; all of it, and the growth, if None.
      limits: for each.
    """
    records = Records(out / "rows.csv", (*KEYS, *_COLUMNS), KEYS, {"versions": versions()})
    items = [Item(*pair) for pair in middle_instances() if problems is None or pair[0] in problems]
    add_rows(records, _COLUMNS, items, measure, limits)
    if problems is None:
        _run_growth(out, limits)
    return records


def simulator_table(rows: Sequence[Mapping[str, str]]) -> str:
    """Markdown: the rates of each problem in thousands of steps a second, and what they come to."""
    good = [row for row in rows if row["simulator_1024"]]
    ratios = [float(row["simulator_1024"]) / float(row["environment"]) for row in good]
    slow = [row for row in good if float(row["environment"]) * _SLOW_STEP_SECONDS < 1]
    compiled = [row for row in good if row["compiled_1024"]]
    share = [float(row["simulator_1024"]) / float(row["compiled_1024"]) for row in compiled]
    single = [float(row["simulator_1"]) / float(row["environment"]) for row in good]
    below = [
        f"{row['problem']} ({ratio:.0f})"
        for row, ratio in zip(good, ratios, strict=True)
        if ratio < 150 and row not in slow
    ]
    late = [row["problem"] for row in good if float(row["made_seconds"]) > 0.1]
    lines = [
        f"With 1,024 replicas {np.median(ratios):,.0f} times pyRDDLGym's steps a second in the "
        f"median of {len(good)} problems, {min(ratios):,.0f} times at least"
        f"{'; below 150 times: ' + ', '.join(below) if below else ''}. "
        f"At least the compiled model's rate on {sum(each >= 1 for each in share)} of "
        f"{len(compiled)} that compile, half of it on {sum(each >= 0.5 for each in share)}. "
        f"Ready within 0.1 s on {len(good) - len(late)}"
        f"{' (not: ' + ', '.join(late) + ')' if late else ''}. "
        f"With one replica {min(single):.1f} to {max(single):.1f} times pyRDDLGym's.",
        "",
        "Thousands of steps a CPU second of one core; seconds until ready.",
        "",
        "| problem | instance | pyRDDLGym | 1 replica | 128 | 1,024 | compiled, 1,024 | ready "
        "| compiled ready |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        rates = [row[name] and f"{float(row[name]) / 1e3:,.1f}" for name in _RATES]
        cells = [row["problem"], row["instance"], *rates, row["made_seconds"]]
        lines.append(f"| {' | '.join(cells)} | {row['compiled_ready_seconds'] or row['cause']} |")
    return "\n".join(lines) + "\n"


def _run_growth(out: Path, limits: Limits) -> None:
    """Rates and memory by the number of objects and of replicas: `growth.csv` and `growth.png`."""
    columns = ("status", "cause", "steps_a_second", "made_seconds", "peak_mb")
    keys = ("problem", "instance")
    records = Records(out / "growth.csv", (*keys, *columns), keys, {"versions": versions()})
    items = [Item("objects", str(size)) for size in OBJECTS]
    items += [Item("replicas", str(count)) for count in GROWN_REPLICAS]
    add_rows(records, columns, items, _grown, limits)
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    for axes, axis in zip(figure.subplots(1, 2), ("objects", "replicas"), strict=True):
        rows = [row for row in records.rows if row["problem"] == axis and row["steps_a_second"]]
        sizes = [int(row["instance"]) for row in rows]
        axes.loglog(sizes, [float(row["steps_a_second"]) for row in rows], "o-", color="C0")
        axes.set_xlabel(
            "reservoirs, 1,024 replicas" if axis == "objects" else "replicas, 30 reservoirs"
        )
        axes.set_ylabel("steps a second", color="C0")
        memory = axes.twinx()
        memory.semilogx(sizes, [float(row["peak_mb"]) for row in rows], "s--", color="C1")
        memory.set_ylim(bottom=0)
        memory.set_ylabel("peak memory (MB)", color="C1")
    write_picture(figure, out / "growth.png", 150)


def _grown(item: Item) -> dict[str, Any]:
    size = int(item.instance) if item.problem == "objects" else 30
    replicas = int(item.instance) if item.problem == "replicas" else 1024
    domain, _ = shipped_files("reservoir30")
    with tempfile.TemporaryDirectory() as folder:
        instance = Path(folder) / "instance.rddl"
        instance.write_text(reservoir_instance(size, 0))
        problem = load_problem(str(domain), str(instance))
    began = time.process_time()
    simulator = Simulator(problem)
    made = time.process_time() - began
    rate = Played(problem).of_simulator(simulator, replicas)
    return {
        "status": "ok",
        "cause": "",
        "steps_a_second": round(rate),
        "made_seconds": round(made, 3),
        "peak_mb": round(peak_mb()),
    }
