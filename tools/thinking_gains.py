"""What thinking is expected to gain, and gains, by the processor's time.

    python tools/thinking_gains.py ROWS SECONDS WITHIN EPISODES RUN...

For each run folder the choice is made in WITHIN seconds for decisions of SECONDS, and the same
episodes are played without thinking and, if a method was chosen, with it. A row is added to ROWS,
with the columns that the file has. The errors are over the episodes; the expected gain is that of
the decisions' own tests, the best of several, and so biased upwards.
Other work on the machine makes it slower but changes no result. Run it on one core, with
XLA_FLAGS=--xla_cpu_multi_thread_eigen=false.
"""

import csv
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl import load_policy, make_environment
from mdpo_rddl.policy.lookahead.choice import choose
from mdpo_rddl.problem.evaluation import evaluate

SEED = 2024


def row(folder: Path, seconds: float, within: float, episodes: int) -> Mapping[str, Any]:
    """The choice of one run's policy and what it gained."""
    policy = load_policy(folder)
    problem = policy.problem
    choice = choose(policy, seconds, within, time.process_time)
    env = make_environment(problem)
    plain = evaluate(env, policy, episodes, SEED).returns
    found = {
        "problem": problem.label,
        "policy": type(policy).__name__,
        "seconds": seconds,
        "within": within,
        "choice": choice.note if choice.policy is None else choice.policy.method.name,
        "trials": "; ".join(
            f"{t.method} {t.mean:.4g} +- {t.error:.2g} at {t.states}"
            for t in choice.trials
            if t.mean is not None and t.error is not None
        ),
        "episodes": episodes,
        "policy_alone": f"{plain.mean():.6g}",
    }
    if choice.policy is None:
        return found
    thinking = evaluate(env, choice.policy, episodes, SEED).returns
    gains, decisions = thinking - plain, choice.policy.decisions
    # the base is left for gains that look large: their own errors are too small
    begins = [place for place, decision in enumerate(decisions) if decision.step == 0]
    expected = np.add.reduceat([decision.gain for decision in decisions], begins)
    return found | {
        "with_thinking": f"{thinking.mean():.6g}",
        "gain": f"{gains.mean():.4g}",
        "gain_error": f"{gains.std(ddof=1) / np.sqrt(episodes):.3g}",
        "expected_gain": f"{expected.mean():.4g}",
        "expected_error": f"{expected.std(ddof=1) / np.sqrt(episodes):.3g}",
        "left_base": sum(d.left_base for d in decisions),
        "decisions": len(decisions),
    }


COLUMNS = (
    *("problem", "policy", "seconds", "within", "choice", "trials", "episodes", "policy_alone"),
    *("with_thinking", "gain", "gain_error", "expected_gain", "expected_error"),
    *("left_base", "decisions"),
)


def main() -> None:
    """Adds the rows, one for each run folder."""
    rows, seconds, within, episodes, *folders = sys.argv[1:]
    path = Path(rows)
    if not path.exists():
        path.write_text(",".join(COLUMNS) + "\n")
    columns = path.read_text().splitlines()[0].split(",")
    for folder in folders:
        found = row(Path(folder), float(seconds), float(within), int(episodes))
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
            writer.writerow(found)


if __name__ == "__main__":
    main()
