"""What a command imports before its options are known to be right, and how long it takes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.plan_command import write_problem

LARGE = ("jax", "pyRDDLGym", "pyRDDLGym_jax", "matplotlib", "scipy")
# of the processor, so that other work on the machine does not count; it takes a fifth of it
SECONDS = 1.0
COMMAND = """
import sys
from mdpo_rddl.cli import {name}
try:
    status = {name}.main(sys.argv[1:])
except SystemExit as end:
    status = end.code
print("imported", *sorted({large!r} & set(sys.modules)), file=sys.stderr)
sys.exit(status)
"""
MISTAKES = [
    ("plan", "", "which problem? Such as: mdpo-plan hvac10"),
    ("plan", "tanks.rddl", "tanks.rddl: which instance? Give its file too"),
    ("plan", "tanks.rddl two.rddl --restarts 0", "--restarts: must be a positive integer"),
    ("plan", "tanks.rddl two.rddl --preset best", "invalid choice: 'best'"),
    ("plan", "tanks.rddl two.rddl --preset auto --batch 2", "--batch does not go with --preset"),
    ("plan", "tanks.rddl two.rddl --sigma 2", "--sigma needs --noise constant"),
    ("plan", "tanks.rddl two.rddl --noise none --alpha 2", "--alpha needs --noise adaptive"),
    ("plan", "tanks.rddl two.rddl --load run --batch 2", "--batch does not go with --load"),
    ("plan", "tanks.rddl two.rddl --load run", "run: no such run folder"),
    ("plan", "tanks.rddl two.rddl --movie a.avi", "a.avi: a movie ends with .gif or .mp4"),
    ("plan", "tanks.rddl two.rddl --start-from run", "run: no such run folder"),
    ("plan", "tanks.rddl two.rddl --start-from run --load run", "--start-from does not go with"),
    ("plan", "tanks.rddl two.rddl --start-from run --replan", "--start-from does not go with"),
    ("plan", "no.rddl two.rddl", "no.rddl: cannot read the domain file"),
    ("plan", "hvac1", "there is no problem 'hvac1'; did you mean hvac"),
    ("plan", "Resevoir 1", "'Resevoir' is neither a file nor a problem of rddlrepository"),
    ("report", "", "the following arguments are required: RUN"),
    ("report", "none", "none: no such run folder"),
    ("ipc", "run", "the following arguments are required: --out"),
    ("ipc", "run --out new --problems tanks.rddl:no.rddl", "no.rddl: no such file"),
    ("ipc", "run --out new --problems tanks.rddl:two.rddl --planners best", "unknown planner"),
]


def children_seconds() -> float:
    times = os.times()
    return times.children_user + times.children_system


def started(name: str, arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    before = children_seconds()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND.format(name=name, large=set(LARGE)), *arguments.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert children_seconds() - before < SECONDS
    assert done.stderr.splitlines()[-1] == "imported"
    return done


@pytest.mark.parametrize("name", ["plan", "ipc"])
def test_help_imports_nothing_large(name: str, tmp_path: Path) -> None:
    done = started(name, "--help", tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith(f"usage: mdpo-{name}")


@pytest.mark.parametrize(("name", "arguments", "said"), MISTAKES)
def test_a_mistake_is_said_before_anything_large_is_imported(
    name: str, arguments: str, said: str, tmp_path: Path
) -> None:
    write_problem(tmp_path)
    done = started(name, arguments, tmp_path)
    assert done.returncode == 2
    (line, _) = done.stderr.splitlines()
    assert said in line
    assert {path.name for path in tmp_path.iterdir()} == {"tanks.rddl", "two.rddl"}
