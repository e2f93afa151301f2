"""Whether a change left every result as it was: records runs, and compares two records.

    python tools/same_results.py record OUT [--checkout FOLDER]  # the runs, by a checkout's code
    python tools/same_results.py compare ONE OTHER                # parameters, returns, history
    python tools/same_results.py load ONE                         # this code plays what ONE holds

The runs: the paper's preset on the six settings, with and without noise, both policies, 200
iterations, seed 0; and three configurations. Results are bit for bit the same on one machine only.
A run that is there already is not made again.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

ROOT = Path(__file__).resolve().parent.parent
SETTINGS = ("hvac10", "hvac20", "powergen7", "powergen11", "reservoir15", "reservoir30")
FIGURES = ("returns", "best_iteration", "iterations", "restart", "last_iterate")
CONFIGS = {
    "drp_adam": """
[Compiler]
sigmoid_weight=20
[Planner]
method='JaxDeepReactivePolicy'
method_kwargs={'topology': [16, 16]}
optimizer='adam'
optimizer_kwargs={'learning_rate': 0.003}
batch_size_train=4
pgpe=None
[Optimize]
key=3
epochs=100
train_seconds=1e300
""",
    "slp_pgpe": """
[Compiler]
[Planner]
method='JaxStraightLinePlan'
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.1}
batch_size_train=8
pgpe='GaussianPGPE'
[Optimize]
key=4
epochs=40
train_seconds=1e300
[Noise]
method='NoNoise'
""",
    "slp_in_calls": """
[Compiler]
[Planner]
method='JaxStraightLinePlan'
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.1}
batch_size_train=8
parallel_updates=2
pgpe=None
[Optimize]
key=5
epochs=100
train_seconds=1e300
[Noise]
method='ConstantNoise'
sigma=0.5
[MDPO]
iterations_per_call=10
test_every=5
""",
}


def domain_of(setting: str) -> Path:
    """The domain file of one of the six settings."""
    return ROOT / "domains" / f"{setting.rstrip('0123456789')}.rddl"


def cases() -> dict[str, list[str]]:
    """Per name of a run folder, the arguments of `mdpo-plan` after the two files."""
    found = {
        f"{setting}-{policy}-{noise}": [
            *("--preset", "paper", "--policy", policy, "--noise", noise),
            *("--iterations", "200", "--seed", "0"),
        ]
        for setting in SETTINGS
        for policy in ("drp", "slp")
        for noise in ("adaptive", "none")
    }
    return found | {f"powergen7-{name}": ["--config", f"{name}.cfg"] for name in CONFIGS}


def problem_of(case: str) -> list[str]:
    """The two files of a case."""
    setting = case.split("-")[0]
    return [str(domain_of(setting)), str(ROOT / "instances" / f"{setting}.rddl")]


def plan(arguments: list[str], checkout: Path, folder: Path) -> None:
    """Runs the command of a checkout in a folder."""
    subprocess.run(
        [sys.executable, "-m", "mdpo_rddl.cli.plan", *arguments, "--episodes", "5", "--quiet"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(checkout)},
        check=True,
    )


def record(out: Path, checkout: Path) -> None:
    """Makes the runs that a folder lacks."""
    out.mkdir(parents=True, exist_ok=True)
    for name, text in CONFIGS.items():
        (out / f"{name}.cfg").write_text(text)
    for case, arguments in cases().items():
        if not (out / case).is_dir():
            plan([*problem_of(case), *arguments, "--out", case], checkout, out)
            print(case, flush=True)


def differences(case: str, one: Path, other: Path, names: tuple[str, ...]) -> list[str]:
    """What differs between the summaries of two runs."""
    summaries = [json.loads((path / case / "summary.json").read_text()) for path in (one, other)]
    return [name for name in names if summaries[0].get(name) != summaries[1].get(name)]


def compare(one: Path, other: Path) -> bool:
    """Whether two records hold the same results, bit for bit."""
    same = True
    for case in cases():
        found = differences(case, one, other, FIGURES)
        tensors = [load_file(path / case / "policy.safetensors") for path in (one, other)]
        if tensors[0].keys() != tensors[1].keys() or not all(
            np.array_equal(tensors[0][name], tensors[1][name]) for name in tensors[0]
        ):
            found.append("parameters")
        for name in ("history.csv", "noise.npy"):
            if (one / case / name).read_bytes() != (other / case / name).read_bytes():
                found.append(name)
        print(case, "differs in " + ", ".join(found) if found else "is the same", flush=True)
        same &= not found
    return same


def load(one: Path) -> bool:
    """Whether this code plays the policies of a record to the same returns."""
    out = one.with_name(one.name + "-loaded")
    out.mkdir(exist_ok=True)
    same = True
    for case in cases():
        plan([*problem_of(case), "--load", str(one.resolve() / case), "--out", case], ROOT, out)
        found = differences(case, one, out, ("returns", "episode_lengths"))
        print(case, "differs in " + ", ".join(found) if found else "is the same", flush=True)
        same &= not found
    return same


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    actions = parser.add_subparsers(dest="action", required=True)
    recording = actions.add_parser("record")
    recording.add_argument("out", type=Path)
    recording.add_argument("--checkout", type=Path, default=ROOT)
    comparing = actions.add_parser("compare")
    comparing.add_argument("one", type=Path)
    comparing.add_argument("other", type=Path)
    actions.add_parser("load").add_argument("one", type=Path)
    options = parser.parse_args()
    if options.action == "record":
        record(options.out, options.checkout.resolve())
        return 0
    same = compare(options.one, options.other) if options.action == "compare" else load(options.one)
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
