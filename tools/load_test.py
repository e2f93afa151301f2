"""Planners side by side with one cache: the same results, deadlines kept, no trouble with locks.

    python tools/load_test.py --planners 8 --cores 2 --seconds 600 --out results/load
    python tools/load_test.py --other FOLDER

In turn, until the seconds are over: a wave of trainings for a given number of iterations, of which
some are killed (writers of the cache among them), and whose policies must be those of a run on its
own; the same with a cache on a full disk, where one can be mounted; and a wave of races, whose
seconds must be kept. With the folder of another version of this project half of the planners are of
that one, and must find what it finds on its own.
"""

import argparse
import contextlib
import itertools
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shelves import same, write_problem

# planner n has seed n modulo 2; where there are two versions, n divided by 2 says which
_SEEDS = 2
# a run that takes longer than that hangs
_LONGEST = 900.0
_FULL_DISK = "256k"
_OURS = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Load:
    """What runs side by side.

    Attributes:
      folder: with the problem and the runs.
      files: of the problem.
      planners: how many at a time.
      memory_gb: that each may have.
      chance: which ones are killed, and when.
      versions: folders of the program's versions, this one's first.
    """

    folder: Path
    files: list[str]
    planners: int
    memory_gb: float
    chance: random.Random
    versions: tuple[Path, ...]

    def kind_of(self, number: int) -> tuple[int, int]:
        """Seed and version of a planner."""
        return number % _SEEDS, number // _SEEDS % len(self.versions)

    def start(self, out: str, options: str, cache: Path, number: int) -> subprocess.Popen[str]:
        """A planner."""
        seed, version = self.kind_of(number)
        more = ["--memory-gb", str(self.memory_gb), "--quiet", "--out", str(self.folder / out)]
        more += ["--seed", str(seed)]
        command = [sys.executable, "-m", "mdpo_rddl.cli.plan", *self.files, *options.split()]
        own = {"PYTHONPATH": str(self.versions[version]), "JAX_COMPILATION_CACHE_DIR": str(cache)}
        return subprocess.Popen(
            [*command, *more], env={**os.environ, **own}, stderr=subprocess.PIPE, text=True
        )

    def wave(self, label: str, options: str, cache: Path, kills: int = 0) -> dict[str, Any]:
        """Planners side by side, of which some are killed.

        Returns:
          Per run folder the exit status, and what it said if that was not 0.
        """
        names = [f"{label}-{number}" for number in range(self.planners)]
        running = {
            name: self.start(name, options, cache, number) for number, name in enumerate(names)
        }
        began, ends = time.monotonic(), {}
        victims = {name: self.chance.uniform(2.0, 30.0) for name in names[:kills]}
        while running:
            for name, process in list(running.items()):
                elapsed = time.monotonic() - began
                if elapsed > victims.get(name, _LONGEST):
                    process.kill()
                if process.poll() is not None:
                    said = running.pop(name).communicate()[1]
                    status, said = process.returncode, said.strip()
                    if status == -signal.SIGKILL and name not in victims:
                        status, said = 1, f"killed after {elapsed:.0f} s: it hung, or no memory"
                    ends[name] = [status, said if status else ""]
            time.sleep(0.02)
        return ends

    def summary(self, out: str) -> dict[str, Any]:
        """What a run says of itself."""
        return json.loads((self.folder / out / "summary.json").read_text())


@contextlib.contextmanager
def full_disk(folder: Path) -> Iterator[bool]:
    """A file system that is full soon; whether it could be mounted."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={_FULL_DISK}", "tmpfs", str(folder)]
    try:
        is_mounted = subprocess.run(mount, capture_output=True).returncode == 0
    except FileNotFoundError:
        is_mounted = False
    try:
        yield is_mounted
    finally:
        if is_mounted:
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


class Figures:
    """What has come of the runs."""

    def __init__(self) -> None:
        self.counts = {"finished": 0, "killed": 0, "same": 0, "other": 0, "late": 0}
        self.failures: list[str] = []
        self.overrun = 0.0

    def add(self, ends: dict[str, Any]) -> list[str]:
        """Counts the ends of runs; the names of those that have finished."""
        for name, (status, said) in ends.items():
            if status == -signal.SIGKILL:
                self.counts["killed"] += 1
            elif status:
                self.failures.append(f"{name}: status {status}: {said}")
        finished = [name for name, (status, _) in ends.items() if status == 0]
        self.counts["finished"] += len(finished)
        return finished

    def compare(self, load: Load, names: list[str]) -> None:
        """Counts which runs have found what a run on its own finds."""
        for name in names:
            seed, version = load.kind_of(int(name.rpartition("-")[2]))
            equal = same(load.folder / f"alone-{seed}-{version}", load.folder / name)
            self.counts["same" if equal else "other"] += 1

    def time(self, load: Load, names: list[str], seconds: float) -> None:
        """Counts which races have kept their seconds within a quarter."""
        for name in names:
            used = load.summary(name)["auto"]["seconds"]
            self.overrun = max(self.overrun, used / seconds - 1.0)
            self.counts["late"] += used > 1.25 * seconds

    def to_json(self) -> dict[str, Any]:
        """All of it."""
        return {**self.counts, "overrun": round(self.overrun, 3), "failures": self.failures}

    @property
    def is_good(self) -> bool:
        """Whether nothing went wrong, and something was seen."""
        wrong = self.failures or self.counts["other"] or self.counts["late"]
        return not wrong and self.counts["same"] > 0


def main() -> int:
    """Runs the test; the exit status is 0 if nothing went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--planners", type=int, default=8)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--iterations", type=int, default=2_000)
    parser.add_argument("--race-seconds", type=float, default=30.0)
    parser.add_argument("--memory-gb", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--other", type=Path, help="folder of another version of this project")
    parser.add_argument("--out", type=Path, help="a folder for the figures")
    options = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])
    training = f"--preset paper --iterations {options.iterations} --episodes 1"
    race = f"--seconds {options.race_seconds:g} --episodes 1"
    figures, began = Figures(), time.monotonic()
    with tempfile.TemporaryDirectory() as name, full_disk(Path(name) / "full") as is_full:
        folder, chance = Path(name), random.Random(options.seed)
        files = write_problem(folder)
        versions = (_OURS,) if options.other is None else (_OURS, options.other.resolve())
        load = Load(folder, files, options.planners, options.memory_gb, chance, versions)
        for number in range(_SEEDS * len(versions)):
            seed, version = load.kind_of(number)
            own = folder / f"own-{version}"
            alone = load.start(f"alone-{seed}-{version}", training, own, number)
            if alone.wait():
                raise SystemExit(f"a run on its own fails: {alone.communicate()[1]}")
        for number in itertools.count():
            kills = options.planners // 4
            ends = load.wave(f"shared{number}", training, folder / "cache", kills)
            figures.compare(load, figures.add(ends))
            if is_full:
                ends = load.wave(f"full{number}", training, folder / "full")
                figures.compare(load, figures.add(ends))
            ends = load.wave(f"race{number}", race, folder / "cache")
            figures.time(load, figures.add(ends), options.race_seconds)
            print(json.dumps({"full disk": is_full, **figures.to_json()}), flush=True)
            if time.monotonic() - began > options.seconds:
                break
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        given = {n: v for n, v in vars(options).items() if n not in ("out", "other")}
        found = {**given, "versions": len(versions), "full disk": is_full, **figures.to_json()}
        (options.out / "figures.json").write_text(json.dumps(found, indent=1) + "\n")
    return int(not figures.is_good)


if __name__ == "__main__":
    sys.exit(main())
