"""Two runs of `mdpo-ipc`, trial by trial: where one planner's returns differ.

    PYTHONPATH=. python tools/compare_runs.py OLD NEW [PLANNER]

OLD and NEW are folders of runs with the same seed, whose trials then meet the same environment
seeds. Prints a row for each instance whose trials are complete in both: the two means, Student's
95% interval of the difference, and which is larger. An older run of this repository is

    git archive COMMIT results/ipc2023 | tar -x -C DIR
"""

import sys
from pathlib import Path

import numpy as np

from benchmarks.common.markdown import rounded, table_head, table_row
from mdpo_rddl.ipc.results import load_results
from mdpo_rddl.problem.evaluation import mean_interval


def returns_of(folder: Path, planner: str) -> dict[str, np.ndarray]:
    """Per instance the return of each trial of a planner, if none has failed."""
    found = {}
    for result in load_results(folder):
        totals = [trial.total for trial in result.trials]
        if result.entry.planner == planner and len(totals) == result.wanted and None not in totals:
            problem = result.entry.problem
            found[f"{problem.domain} {problem.instance}"] = np.array(totals, float)
    return found


def comparison(old: dict[str, np.ndarray], new: dict[str, np.ndarray]) -> str:
    """The table, with how often the new returns are above, below and neither."""
    lines = [*table_head(["instance", "old", "new", "difference, 95% interval", "new is"])]
    counts = dict.fromkeys(("above", "below", "undecided"), 0)
    for name in sorted(old.keys() & new.keys()):
        if len(old[name]) != len(new[name]):
            sys.exit(f"{name} has {len(old[name])} and {len(new[name])} trials")
        differences = new[name] - old[name]
        low, high = mean_interval(differences) or (-np.inf, np.inf)
        verdict = "above" if low > 0.0 else "below" if high < 0.0 else "undecided"
        counts[verdict] += 1
        interval = f"[{rounded(low, 4)}, {rounded(high, 4)}]"
        means = rounded(old[name].mean(), 6), rounded(new[name].mean(), 6)
        lines.append(table_row([name, *means, interval, verdict]))
    total = ", ".join(f"{verdict} on {count}" for verdict, count in counts.items())
    return "\n".join([*lines, "", total])


if __name__ == "__main__":
    folders, planner = [Path(each) for each in sys.argv[1:3]], (*sys.argv[3:], "mdpo")[0]
    print(comparison(*(returns_of(folder, planner) for folder in folders)))
