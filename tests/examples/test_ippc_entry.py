"""The competition's entry, under timers so short that they interrupt."""

import subprocess
import sys

import pytest
from helpers.problems import ROOT, tiny_files

MAIN = ROOT / "examples" / "clients" / "ippc_entry" / "main.py"


def played(folder, *options):
    done = subprocess.run(
        [sys.executable, str(MAIN), *tiny_files(folder, horizon=3), "2", *options],
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def episodes(lines):
    return [float(line.split(": ")[1]) for line in lines if line.startswith("episode")]


@pytest.mark.long
@pytest.mark.timeout(300)
def test_an_interrupted_preparation_leaves_a_policy_that_plays(tmp_path):
    options = ["--prepare", "600", "--timer", "4", "--decide", "30", "--grace", "200"]
    lines = played(tmp_path, *options)
    assert lines[:2] == ["preparation was interrupted", "policy: found"]
    # the no-op stays half a unit from the goal, in both of them and all three steps
    assert len(episodes(lines)) == 2
    assert all(-1.5 <= total <= 0.0 for total in episodes(lines))


@pytest.mark.long
@pytest.mark.timeout(300)
def test_interrupted_decisions_are_no_ops_and_the_episode_goes_on(tmp_path):
    # no decision is made in that time
    lines = played(tmp_path, "--prepare", "5", "--timer", "120", "--decide", "0.00001")
    assert lines[0] == "policy: found"
    assert episodes(lines) == pytest.approx([-1.5, -1.5])
