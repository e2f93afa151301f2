"""Kills runs of mdpo-plan at random moments, resumes them, and compares with an unbroken run.

    python tools/kill_runs.py --kills 100
    python tools/kill_runs.py --seconds 3 --kills 30
    python tools/kill_runs.py --races --kills 30

A toy problem is trained with a checkpoint every twentieth of a second, so that many of the kills
fall into the writing of one. What is compared: the policy's parameters, the history and the noise,
bit for bit.

Trainings that seconds bound end where the clock says, and are not compared. They are killed at any
time, the evaluation among it, which takes longer than the training: what is looked at is that they
can be resumed and finished, with no fewer iterations than the checkpoint had.

Of races, what is looked at after each kill is the checkpoint: neither the incumbent's return nor
the seconds may be less than after the kill before; and the result of the race is not worse than
the last incumbent.
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
from typing import NamedTuple

from shelves import same, write_problem

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.container import read_container

# of a training that seconds bound: more of them take longer than the training
_EPISODES = 500


def command(folder: Path, out: str, iterations: int) -> list[str]:
    """A run that leaves a checkpoint twenty times a second."""
    files = [str(folder / "shelves.rddl"), str(folder / "three.rddl")]
    options = f"--preset paper --iterations {iterations} --episodes 1 --quiet --resume"
    where = ["--out", str(folder / out), "--checkpoint-seconds", "0.05"]
    return [sys.executable, "-m", "mdpo_rddl.cli.plan", *files, *options.split(), *where]


def bounded_command(folder: Path, out: str, seconds: float) -> list[str]:
    """A training that the seconds end, with a long evaluation."""
    files = [str(folder / "shelves.rddl"), str(folder / "three.rddl")]
    options = f"--preset paper --iterations 100000000 --seconds {seconds} --episodes {_EPISODES}"
    where = ["--out", str(folder / out), "--checkpoint-seconds", "0.2", "--quiet", "--resume"]
    return [sys.executable, "-m", "mdpo_rddl.cli.plan", *files, *options.split(), *where]


def race_command(folder: Path, out: str, seconds: float) -> list[str]:
    """A race that leaves a checkpoint twice a second."""
    files = [str(folder / "shelves.rddl"), str(folder / "three.rddl")]
    options = f"--seconds {seconds} --episodes 1 --quiet --resume --checkpoint-seconds 0.5"
    where = ["--out", str(folder / out)]
    return [sys.executable, "-m", "mdpo_rddl.cli.plan", *files, *options.split(), *where]


def newest(folder: Path) -> int:
    """When the newest checkpoint was written."""
    times = []
    for path in folder.glob("*-?.safetensors"):
        with contextlib.suppress(OSError):  # replaced meanwhile
            times.append(path.stat().st_mtime_ns)
    return max(times, default=0)


def kill_once(
    arguments: list[str], unfinished: Path, chance: random.Random, longest: float = 0.4
) -> str:
    """Starts the run and kills it; "finished" if that came too late.

    Args:
      arguments: of the run.
      unfinished: where its checkpoints are.
      chance: when.
      longest: seconds after a checkpoint, for most kills.
    """
    before = newest(unfinished)
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True) as process:
        if chance.random() < 0.2:  # anywhere, the start among it
            until = time.monotonic() + chance.uniform(0.0, 8.0)
        else:
            until = float("inf")
        while process.poll() is None and time.monotonic() < until:
            if until == float("inf") and newest(unfinished) > before:
                until = time.monotonic() + chance.uniform(0.0, longest)
            time.sleep(0.002)
        return killed(process)


def kill_within(arguments: list[str], seconds: float) -> str:
    """Starts the run and kills it after so many seconds; "finished" if that came too late."""
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True) as process:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
        return killed(process)


def killed(process: subprocess.Popen[str]) -> str:
    """Kills a run, unless it has ended: how it did."""
    process.kill()
    error = process.communicate()[1]
    if process.returncode == -signal.SIGKILL:
        return "killed"
    return "finished" if process.returncode == 0 else f"status {process.returncode}: {error}"


class Left(NamedTuple):
    """What a race has left: each part of it may only grow."""

    mean: float
    seconds: float

    def lost_since(self, before: "Left") -> list[str]:
        """What there was less of than before."""
        return [name for name in self._fields if getattr(self, name) < getattr(before, name)]


def left(folder: Path) -> Left | None:
    """What the newest checkpoint that can be read holds; None if there is none."""
    found = []
    for path in sorted(folder.glob("incumbent-?.safetensors")):
        with contextlib.suppress(InputError):
            text, _ = read_container(path, ("mdpo-rddl race 4",))
            one = Left(json.loads(text["about"])[0]["mean"], float(text["seconds"]))
            found.append((int(text["number"]), one))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def kill_races(folder: Path, kills: int, seconds: float, chance: random.Random) -> bool:
    """Kills races until there were so many kills; whether nothing was lost."""
    figures = {"kills": 0, "with a checkpoint": 0, "races": 0, "seconds": [], "failures": []}
    failures = figures["failures"]
    while figures["kills"] < kills:
        out, before, end = f"race{figures['races']}", None, "killed"
        arguments, unfinished = race_command(folder, out, seconds), folder / f"{out}.unfinished"
        while end == "killed" and figures["kills"] < kills:
            end = kill_once(arguments, unfinished, chance, longest=seconds / 4)
            if end != "killed":
                break
            figures["kills"] += 1
            now = left(unfinished)
            figures["with a checkpoint"] += now is not None
            if before is not None:
                failures += ["the checkpoint"] if now is None else now.lost_since(before)
            before = now or before
            print(json.dumps(figures), flush=True)
        if end == "killed":
            end = "finished" if subprocess.run(arguments).returncode == 0 else "failed"
        figures["races"] += 1
        if end != "finished":
            failures.append(end)
            continue
        race = json.loads((folder / out / "summary.json").read_text())["auto"]
        means = [one["mean_return"] for one in race["candidates"] if one["became_incumbent"]]
        figures["seconds"].append(race["seconds"])
        if before is not None and max(means) < before.mean:
            failures.append(f"{max(means)} after {before.mean}")
        print(json.dumps(figures), flush=True)
    return not failures


def used(folder: Path) -> tuple[float, int]:
    """The seconds and the iterations in the newest checkpoint of a training; 0 without any."""
    found = [(0.0, 0)]
    for path in folder.glob("checkpoint-?.safetensors"):
        with contextlib.suppress(InputError):  # its writing was killed
            text, _ = read_container(path, ("mdpo-rddl checkpoint 2",))
            numbers = json.loads(text["numbers"])
            found.append((numbers["seconds"], numbers["iterations"]))
    return max(found)


def kill_bounded(folder: Path, kills: int, seconds: float, chance: random.Random) -> bool:
    """Kills trainings that seconds bound, each up to three times; whether all could be finished."""
    began = time.monotonic()
    subprocess.run(bounded_command(folder, "whole", seconds), check=True)
    longest = time.monotonic() - began
    figures = {"kills": 0, "time used up": 0, "runs": 0, "failures": []}
    while figures["kills"] < kills:
        out, before, end = f"bounded{figures['runs']}", 0, "killed"
        arguments = bounded_command(folder, out, seconds)
        for _ in range(min(3, kills - figures["kills"])):
            end = kill_within(arguments, chance.uniform(0.0, longest))
            if end != "killed":
                break
            now, before = used(folder / f"{out}.unfinished")
            figures["kills"] += 1
            figures["time used up"] += now >= seconds
        if end == "killed":
            end = "finished" if subprocess.run(arguments).returncode == 0 else "failed"
        if end != "finished":
            figures["failures"].append(end)
        elif json.loads((folder / out / "summary.json").read_text())["iterations"] < before:
            figures["failures"].append(f"fewer iterations than {before}")
        figures["runs"] += 1
        print(json.dumps(figures), flush=True)
    return not figures["failures"]


def main() -> int:
    """Runs the campaign; the exit status is 0 if nothing was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--iterations", type=int, default=6_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--races", action="store_true")
    parser.add_argument("--seconds", type=float, help="of a race, 40 by default; of a training")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    figures = {"kills": 0, "runs": 0, "same": 0, "failures": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_problem(folder)
        if options.races:
            return int(not kill_races(folder, options.kills, options.seconds or 40.0, chance))
        if options.seconds is not None:
            return int(not kill_bounded(folder, options.kills, options.seconds, chance))
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
