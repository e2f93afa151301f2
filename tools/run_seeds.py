"""Runs of `mdpo-ipc` that differ in their seed: what a planner returns on each instance.

    python tools/run_seeds.py OLD RUN RUN... > TABLE

Prints a row for each instance that is complete in all: the mean return of OLD, a run with one seed,
and of each RUN, the runs' mean with Student's 95% interval over their seeds, and whether OLD's mean
is below or above that interval. What OLD would return with other seeds is not known. An older run
of this repository is

    git archive COMMIT results/ipc2023 | tar -x -C DIR
"""

import sys
from pathlib import Path

import numpy as np
from compare_runs import returns_of

from mdpo_rddl.bench.common.markdown import rounded, table_head, table_row
from mdpo_rddl.problem.evaluation import mean_interval

_PLANNER = "mdpo"


def seeds_table(old: dict[str, float], runs: list[dict[str, float]]) -> str:
    """The table, with how often the new returns are above, below and neither.

    Args:
      old: mean returns per instance.
      runs: likewise, of each seed.
    """
    seeds = [f"run {number}" for number in range(1, len(runs) + 1)]
    lines = [*table_head(["instance", "old", *seeds, "mean, 95% interval", "new is"])]
    counts = dict.fromkeys(("above", "below", "undecided"), 0)
    for name in sorted(set(old).intersection(*runs)):
        means = np.array([run[name] for run in runs])
        low, high = mean_interval(means) or (-np.inf, np.inf)
        verdict = "above" if low > old[name] else "below" if high < old[name] else "undecided"
        counts[verdict] += 1
        interval = f"{rounded(means.mean(), 6)} [{rounded(low, 5)}, {rounded(high, 5)}]"
        cells = [rounded(mean, 6) for mean in (old[name], *means)]
        lines.append(table_row([name, *cells, interval, verdict]))
    total = ", ".join(f"{verdict} on {count}" for verdict, count in counts.items())
    return "\n".join([*lines, "", total])


if __name__ == "__main__":
    found = [returns_of(Path(each), _PLANNER) for each in sys.argv[1:]]
    first, *others = [{name: float(own.mean()) for name, own in run.items()} for run in found]
    print(seeds_table(first, others))
