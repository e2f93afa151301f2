"""Runs of `mdpo-ipc` that differ in their seed: what a planner returns on each instance.

    PYTHONPATH=. python tools/run_seeds.py OLD RUN RUN... > TABLE

Prints a row for each instance that is complete in all: the mean return of OLD, a run with one seed,
and of each RUN, and what the mean over these is more than OLD's, with Welch's 95% interval: over
the seeds for the RUNs, over the trials for OLD. What OLD would find with other seeds is not known.
An older run of this repository is

    git archive COMMIT results/ipc2023 | tar -x -C DIR
"""

import sys
from pathlib import Path

import numpy as np
from compare_runs import returns_of
from scipy import stats

from benchmarks.common.markdown import rounded, table_head, table_row

_PLANNER = "mdpo"


def seeds_table(old: dict[str, np.ndarray], runs: list[dict[str, np.ndarray]]) -> str:
    """The table, with how often the new returns are above, below and neither.

    Args:
      old: returns of the trials, per instance.
      runs: likewise, of each seed.
    """
    seeds = [f"run {number}" for number in range(1, len(runs) + 1)]
    lines = [*table_head(["instance", "old", *seeds, "mean", "more, 95% interval", "new is"])]
    counts = dict.fromkeys(("above", "below", "undecided"), 0)
    for name in sorted(set(old).intersection(*runs)):
        means = np.array([run[name].mean() for run in runs])
        low, high = _welch_interval(means, old[name])
        verdict = "above" if low > 0.0 else "below" if high < 0.0 else "undecided"
        counts[verdict] += 1
        cells = [rounded(mean, 6) for mean in (old[name].mean(), *means, means.mean())]
        interval = f"[{rounded(low, 4)}, {rounded(high, 4)}]"
        lines.append(table_row([name, *cells, interval, verdict]))
    total = ", ".join(f"{verdict} on {count}" for verdict, count in counts.items())
    return "\n".join([*lines, "", total])


def _welch_interval(new: np.ndarray, old: np.ndarray) -> tuple[float, float]:
    """95% interval of the difference of two means."""
    difference = float(new.mean() - old.mean())
    if not (np.ptp(new) or np.ptp(old)):
        return difference, difference
    low, high = stats.ttest_ind(new, old, equal_var=False).confidence_interval()
    return float(low), float(high)


if __name__ == "__main__":
    found = [returns_of(Path(each), _PLANNER) for each in sys.argv[1:]]
    print(seeds_table(found[0], found[1:]))
