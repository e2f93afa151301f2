"""Kills runs of mdpo-plan at random moments, resumes them, and compares with an unbroken run.

    python tools/kill_runs.py --kills 100

A toy problem is trained with a checkpoint every twentieth of a second, so that many of the kills
fall into the writing of one. What is compared: the policy's parameters, the history and the noise,
bit for bit.
"""

import argparse
import contextlib
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shelves import same, write_problem


def command(folder: Path, out: str, iterations: int) -> list[str]:
    """A run that leaves a checkpoint twenty times a second."""
    files = [str(folder / "shelves.rddl"), str(folder / "three.rddl")]
    options = f"--preset paper --iterations {iterations} --episodes 1 --quiet --resume"
    where = ["--out", str(folder / out), "--checkpoint-seconds", "0.05"]
    return [sys.executable, "-m", "mdpo_rddl.cli.plan", *files, *options.split(), *where]


def newest(folder: Path) -> int:
    """When the newest checkpoint was written."""
    times = []
    for path in folder.glob("checkpoint-*.safetensors"):
        with contextlib.suppress(OSError):  # replaced meanwhile
            times.append(path.stat().st_mtime_ns)
    return max(times, default=0)


def kill_once(arguments: list[str], unfinished: Path, chance: random.Random) -> str:
    """Starts the run and kills it; "finished" if that came too late."""
    before = newest(unfinished)
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True) as process:
        if chance.random() < 0.2:  # anywhere, the start among it
            until = time.monotonic() + chance.uniform(0.0, 8.0)
        else:
            until = float("inf")
        while process.poll() is None and time.monotonic() < until:
            if until == float("inf") and newest(unfinished) > before:
                until = time.monotonic() + chance.uniform(0.0, 0.4)
            time.sleep(0.002)
        process.kill()
        error = process.communicate()[1]
    if process.returncode == -signal.SIGKILL:
        return "killed"
    return "finished" if process.returncode == 0 else f"status {process.returncode}: {error}"


def main() -> int:
    """Runs the campaign; the exit status is 0 if nothing was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--iterations", type=int, default=6_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    figures = {"kills": 0, "runs": 0, "same": 0, "failures": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_problem(folder)
        subprocess.run(command(folder, "whole", options.iterations), check=True)
        while figures["kills"] < options.kills:
            out = f"run{figures['runs']}"
            arguments = command(folder, out, options.iterations)
            end = "killed"
            while end == "killed" and figures["kills"] < options.kills:
                end = kill_once(arguments, folder / f"{out}.unfinished", chance)
                figures["kills"] += end == "killed"
                print(json.dumps(figures), flush=True)
            if end == "killed":
                end = "finished" if subprocess.run(arguments).returncode == 0 else "failed"
            figures["runs"] += 1
            if end != "finished":
                figures["failures"].append(end)
            else:
                figures["same"] += same(folder / "whole", folder / out)
            print(json.dumps(figures), flush=True)
    return int(bool(figures["failures"]) or figures["same"] != figures["runs"])


if __name__ == "__main__":
    sys.exit(main())
