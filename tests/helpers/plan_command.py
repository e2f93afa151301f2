"""`mdpo-plan` as tests run it: a problem that compiles fast, and what a run of it came to."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from helpers.files import contents

DOMAIN = """\
domain tanks {
    types { tank : object; };
    pvariables {
        LEVEL(tank) : { non-fluent, real, default = 10.0 };
        volume(tank) : { state-fluent, real, default = 5.0 };
        fill(tank) : { action-fluent, real, default = 0.0 };
    };
    cpfs {
        volume'(?t) = volume(?t) + fill(?t) - Uniform(0.0, 1.0);
    };
    reward = sum_{?t : tank} [-abs[volume(?t) - LEVEL(?t)]];
    action-preconditions {
        forall_{?t : tank} [fill(?t) >= 0.0];
        forall_{?t : tank} [fill(?t) <= 3.0];
    };
}
"""
INSTANCE = """\
non-fluents nf_two {
    domain = tanks;
    objects { tank : {t1, t2}; };
    non-fluents { LEVEL(t2) = 8.0; };
}
instance two {
    domain = tanks;
    non-fluents = nf_two;
    init-state { volume(t1) = 2.0; };
    max-nondef-actions = pos-inf;
    horizon = 7;
    discount = 1.0;
}
"""
CONFIG = """\
[Compiler]
sigmoid_weight=10

[Planner]
method='JaxStraightLinePlan'
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.1}
batch_size_train=2
batch_size_test=2
rollout_horizon=3
pgpe=None

[Optimize]
key=5
epochs=4
train_seconds=60
print_summary=True

[Noise]
method='ConstantNoise'
sigma=0.5
"""
TANKS = "tanks.rddl two.rddl"
OPTIONS = f"{TANKS} --iterations 30 --episodes 3"
RUN_FILES = {
    "summary.json",
    "policy.safetensors",
    "config.json",
    "history.csv",
    "noise.npy",
    "learning_curve.png",
    "noise.png",
    "trajectories.npz",
    "report.html",
}


class Outcome(NamedTuple):
    """What a command came to."""

    status: int
    out: str
    err: str

    @property
    def summary(self) -> dict[str, Any]:
        assert self.status == 0, self.err
        return json.loads(self.out.splitlines()[-1])


class Run(NamedTuple):
    """A finished run: where it was started, its folder, and what the command printed."""

    cwd: Path
    folder: Path
    outcome: Outcome

    @property
    def summary(self) -> dict[str, Any]:
        return json.loads((self.folder / "summary.json").read_text())


def write_problem(folder: Path) -> None:
    (folder / "tanks.rddl").write_text(DOMAIN)
    (folder / "two.rddl").write_text(INSTANCE)


def in_a_process(arguments: str, folder: Path) -> Outcome:
    """Runs the command as a user does."""
    done = subprocess.run(
        [sys.executable, "-m", "mdpo_rddl.cli.plan", *arguments.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def run(arguments: str, capsys: pytest.CaptureFixture[str]) -> Outcome:
    """Runs the command in this process and the current folder."""
    from mdpo_rddl.cli import plan as command  # pytest's controller needs no JAX

    capsys.readouterr()
    try:
        status = command.main(arguments.split())
    except SystemExit as end:
        status = end.code
    return Outcome(status, *capsys.readouterr())


def refuse(
    arguments: str, said: str, folder: Path, capsys: pytest.CaptureFixture[str], start: bool = False
) -> None:
    """The command ends with status 2 and one line, and changes nothing in the folder."""
    before = contents(folder)
    outcome = run(arguments, capsys)
    assert outcome.status == 2
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    assert len(lines) == 1, outcome.err
    if start:
        assert lines[0].startswith(f"mdpo-plan: error: {said}")
    else:
        assert lines[0] == f"mdpo-plan: error: {said}"
    assert contents(folder) == before


def history(folder: Path) -> dict[str, list[float]]:
    with (folder / "history.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a problem in it."""
    write_problem(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """One real run, which many tests look at and none changes."""
    cwd = tmp_path_factory.mktemp("finished")
    write_problem(cwd)
    return Run(cwd, cwd / "run", in_a_process(f"{OPTIONS} --out run --json", cwd))
