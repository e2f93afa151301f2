"""Whether samples around a policy's actions gain more with adaptive or with isotropic noise.

    python tools/noise_of_residuals.py ROWS SECONDS WITHIN RUN...

For each run folder two of the method "residuals" decide at the same states, WITHIN seconds in all
with SECONDS a decision: one whose noise follows the return's sensitivity to the action of a step,
and one with the same noise at all steps. Both make the same gradient steps first. A row is added
to ROWS: what each gains a decision in common fresh scenarios, as `choose` measures it.
"""

import sys
from pathlib import Path
from typing import Any

from rows import Rows

from mdpo_rddl import load_policy
from mdpo_rddl.policy.lookahead.choice import choose
from mdpo_rddl.policy.lookahead.residuals import Residuals

COLUMNS = (
    *("problem", "seconds", "states", "adaptive", "error", "isotropic", "isotropic_error"),
    "commit",
)


def row(folder: Path, seconds: float, within: float) -> dict[str, Any]:
    """Both gains at the states that one run's policy visits."""
    policy = load_policy(folder)
    methods = [Residuals(name="adaptive"), Residuals(name="isotropic", adaptive=False)]
    found: dict[str, Any] = {"problem": policy.problem.label, "seconds": seconds}
    for trial in choose(policy, seconds, within, methods=methods).trials:
        if trial.mean is None or trial.error is None:
            raise SystemExit(f"{folder}: {trial.method}: {trial.note}")
        error = "error" if trial.method == "adaptive" else "isotropic_error"
        found |= {trial.method: f"{trial.mean:.5g}", error: f"{trial.error:.3g}"}
        found["states"] = trial.states
    return found


def main() -> None:
    """Adds the rows, one for each run folder."""
    path, seconds, within, *folders = sys.argv[1:]
    rows = Rows(path, COLUMNS)
    for folder in folders:
        rows.add(row(Path(folder), float(seconds), float(within)))


if __name__ == "__main__":
    main()
