"""Plays the no-op in the episodes of the published returns, beside what was published of it.

Usage: python tools/published_noop.py OUT.csv

Each row has the published mean return, ours in all steps and before the last one, and how much our
returns vary: where they do not, the seeds cannot be told from others.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from benchmarks.tasks.published import published
from benchmarks.tasks.published_episodes import ShorterReturns, published_seeds
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment

EPISODES = 20
HEADS = ("problem", "instance", "published", "ours", "before_the_last_step", "std")


def main(out: Path) -> None:
    """Writes a row for each of the 81 tasks, as it comes."""
    with out.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADS)
        for task, row in published().items():
            problem = load_problem(task.problem, task.instance)
            env = make_environment(problem)
            shorter = ShorterReturns(problem.horizon, env.discount)
            seeds = published_seeds(EPISODES)
            played = evaluate(env, lambda *_: {}, EPISODES, seeds, recorder=shorter)
            figures = (played.mean, float(np.mean(shorter.returns)), played.std)
            cells = (f"{figure:.8g}" for figure in figures)
            writer.writerow((task.problem, task.instance, row["noop"], *cells))
            file.flush()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
