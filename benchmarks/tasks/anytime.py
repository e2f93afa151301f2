"""What more time is worth: the same tasks with shorter and longer preparations."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.common.markdown import rounded, table_head, table_row
from benchmarks.common.records import Records
from benchmarks.tasks.names import OURS
from benchmarks.tasks.trial import COLUMNS, KEYS, OK, Conditions, Task, run_tasks
from mdpo_rddl.errors import InputError

Returns = Mapping[Task, Mapping[float, np.ndarray]]
"""Per task and seconds of preparation the mean return of each seed [S], one without as -inf."""


def run_anytime(out: Path, tasks: Sequence[Task], seeds: int, times: Sequence[Conditions]) -> None:
    """Prepares and plays; rows that are there already are skipped.

    Args:
      out: results folder, in which each time has its own.
      tasks: in the order in which they are tried.
      seeds: of the preparation, from 0.
      times: the conditions of each time.
    """
    for conditions in times:
        run_tasks(out / f"{conditions.seconds:g}", tasks, [OURS], seeds, conditions)


def read_anytime(out: Path) -> dict[Task, dict[float, np.ndarray]]:
    """What `run_anytime` has measured so far, times in ascending order.

    Raises:
      InputError: if a file holds anything else.
    """
    found: dict[Task, dict[float, list[float]]] = {}
    try:
        paths = {float(path.parent.name): path for path in out.glob("*/rows.csv")}
        for seconds in sorted(paths):
            for row in Records(paths[seconds], COLUMNS, KEYS).rows:
                task = Task(row["problem"], row["instance"])
                mean = float(row["mean"]) if row["status"] == OK else -np.inf
                found.setdefault(task, {}).setdefault(seconds, []).append(mean)
    except ValueError as error:
        raise InputError(f"{out}: holds other results than anytime's: {error}") from error
    return {
        task: {seconds: np.array(means) for seconds, means in times.items()}
        for task, times in found.items()
    }


def falls(times: Mapping[float, np.ndarray]) -> list[tuple[float, float]]:
    """Pairs of times of which the longer one has a median below all seeds of the shorter one.

    Of five seeds the smallest and the largest are the 93.75% interval of the median, whatever the
    distribution. Seeds without a return are left out of the shorter time.
    """
    known = {time: means[np.isfinite(means)] for time, means in times.items()}
    least = {time: float(np.min(means)) for time, means in known.items() if len(means)}
    return [
        (short, long)
        for short in least
        for long, means in times.items()
        if short < long and float(np.median(means)) < least[short]
    ]


def anytime_table(returns: Returns) -> str:
    """Markdown: median, smallest and largest seed per task and time, and where more time lost."""
    seconds = sorted({time for times in returns.values() for time in times})
    heads = ["problem", "instance", "seeds", *(f"{time:g} s" for time in seconds), "falls"]
    lines = table_head(heads)
    falling = 0
    for task, times in sorted(returns.items(), key=lambda item: str(item[0])):
        count = max(len(means) for means in times.values())
        cells = [_cell(times.get(time)) for time in seconds]
        found = falls(times)
        falling += bool(found)
        notes = ", ".join(f"{short:g} to {long:g} s" for short, long in found)
        names = [task.problem, task.instance, str(count)]
        lines.append(table_row([*names, *cells, notes]))
    note = "Median of the seeds' mean returns [smallest, largest]. The median falls below the "
    note += f"interval of a shorter time on {falling} of {len(returns)} tasks."
    return "\n".join([*lines, "", note]) + "\n"


def _cell(means: np.ndarray | None) -> str:
    if means is None:
        return ""
    low, middle, high = (rounded(value(means), 6) for value in (np.min, np.median, np.max))
    return middle if len(means) == 1 else f"{middle} [{low}, {high}]"
