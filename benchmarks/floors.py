"""Floors: returns below which a change to the planner is a regression.

    python benchmarks/floors.py             plan each problem, exit with 1 if a floor fell
    python benchmarks/floors.py --record    set the floors from three seeds of this version

Each problem of `floors.csv` is planned by the command `mdpo-plan` as a user would, 15 s on one
core, without programs kept from earlier runs; one problem for each core that this process may use,
two at most. Its return is the mean over the run's own evaluation episodes.

The floor of a problem is the smallest of its seeds' means less a margin: the largest of their
range, two standard errors of a mean over the episodes, and 1% of that smallest mean. A return below
its floor is measured again with the next seed, and only if that is below as well the floor fell. A
run that fails is as one below.

Rows are written as they come; a run into the same `--out` goes on where that one stopped. Seconds
are by the clock: a run that had less than half of its core sets no floor, and the table tells which
had. Floors hold for machines at least as fast as the one they were recorded on: on a slower one,
record first.
"""

import argparse
import csv
import json
import math
import os
import queue
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
FLOORS = HERE / "floors.csv"
COLUMNS = ["problem", "instance", "kind", "floor", "means", "standard_error", "commit"]
ROW_COLUMNS = ["problem", "instance", "seed", "mean", "standard_error", "episodes", "arm"]
ROW_COLUMNS += ["core_share", "wall_seconds", "cause", "commit"]
SECONDS = 15
# with start-up, evaluation and report
LIMIT_SECONDS = 300
LEAST_SHARE = 0.5

Row = dict[str, str]


def main() -> int:
    """The command; returns the exit status."""
    options = parsed_options()
    floors = read_rows(FLOORS)
    chosen = [row for row in floors if not options.only or row["problem"] in options.only]
    if not chosen:
        print(f"{FLOORS}: none of {', '.join(options.only)}", file=sys.stderr)
        return 2
    unset = [row["problem"] for row in chosen if not row["floor"]]
    if unset and not options.record:
        print(f"{FLOORS}: no floor of {', '.join(unset)}: --record sets it", file=sys.stderr)
        return 2
    commit = described_commit()
    out = options.out or HERE.parent / "runs" / "floors" / commit
    rows_file = out / "rows.csv"
    # what is not committed has no name to resume by
    if options.out is None and commit.endswith("+"):
        rows_file.unlink(missing_ok=True)
    done = {row_key(row): row for row in read_rows(rows_file)}
    if any(row["commit"] != commit for row in done.values()):
        print(f"{rows_file}: holds rows of another commit than {commit}", file=sys.stderr)
        return 2
    first = options.seed
    seeds = range(first, first + options.record) if options.record else [first]
    jobs = [(floor, seed) for seed in seeds for floor in chosen]
    rows = measured(jobs, done, out, commit)
    if options.record:
        for floor in chosen:
            set_floor(floor, [rows[floor["problem"], floor["instance"], str(s)] for s in seeds])
        write_rows(FLOORS, COLUMNS, floors)
        return 0
    below = [floor for floor in chosen if is_below(rows[key_of(floor, first)], floor)]
    rows |= measured([(floor, first + 1) for floor in below], done, out, commit)
    fallen = [floor for floor in below if is_below(rows[key_of(floor, first + 1)], floor)]
    print_table(chosen, rows, first, fallen)
    return 1 if fallen else 0


def parsed_options() -> argparse.Namespace:
    """The command's options."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").split("\n\n")[0],
        epilog="Exit status: 0 if all floors hold, 1 if one fell, 2 for bad input.",
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="PROBLEM")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--record", type=int, nargs="?", const=3, metavar="SEEDS", help="set the floors (3 seeds)"
    )
    parser.add_argument(
        "--out", type=Path, help="folder of rows and runs (default: runs/floors/COMMIT)"
    )
    return parser.parse_args()


def measured(
    jobs: Iterable[tuple[Row, int]], done: dict[tuple[str, ...], Row], out: Path, commit: str
) -> dict[tuple[str, ...], Row]:
    """A row for each job (floor's row, seed), `done` first; new rows are added to `out`."""
    cores: queue.Queue[int] = queue.Queue()
    for core in sorted(os.sched_getaffinity(0))[:2]:
        cores.put(core)

    def run(job: tuple[Row, int]) -> Row:
        core = cores.get()
        try:
            return {**plan(*job, core, out), "commit": commit}
        finally:
            cores.put(core)

    missing = [job for job in jobs if key_of(*job) not in done]
    pool = ThreadPoolExecutor(cores.qsize())
    try:
        for row in map_as_completed(pool, run, missing):
            add_row(out / "rows.csv", row)
            done[row_key(row)] = row
            said = row["cause"] or f"{float(row['mean']):.6g}"
            print(f"{row['problem']} {row['instance']} seed {row['seed']}: {said}", flush=True)
    finally:
        pool.shutdown(cancel_futures=True)
    return {key_of(*job): done[key_of(*job)] for job in jobs}


def map_as_completed(
    pool: ThreadPoolExecutor, run: Callable[[tuple[Row, int]], Row], jobs: list[tuple[Row, int]]
) -> Iterable[Row]:
    """The rows in the order in which they come."""
    rows: queue.Queue[Row | BaseException] = queue.Queue()
    for job in jobs:
        future = pool.submit(run, job)
        future.add_done_callback(
            lambda f: None if f.cancelled() else rows.put(f.exception() or f.result())
        )
    for _ in jobs:
        row = rows.get()
        if isinstance(row, BaseException):
            raise row
        yield row


def plan(floor: Row, seed: int, core: int, out: Path) -> Row:
    """One run of `mdpo-plan` on one core."""
    folder = out / f"{floor['problem']}-{floor['instance']}-{seed}"
    command = ["taskset", "--cpu-list", str(core), str(Path(sys.executable).with_name("mdpo-plan"))]
    command += [floor["problem"], floor["instance"], "--seconds", str(SECONDS), "--seed", str(seed)]
    command += ["--out", str(folder), "--no-cache", "--quiet"]
    row = {"problem": floor["problem"], "instance": floor["instance"], "seed": str(seed)}
    row |= {"mean": "", "standard_error": "", "episodes": "", "arm": "", "cause": ""}
    log, began = folder.with_suffix(".log"), time.monotonic()
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("w") as output:
        child = subprocess.Popen(command, stdout=output, stderr=output)
    status, cpu_seconds = ended(child)
    wall_seconds = time.monotonic() - began
    if status != 0:
        last = log.read_text().strip().splitlines()[-1:] or [""]
        row["cause"] = f"status {status}: {last[0]}"
    else:
        summary = json.loads((folder / "summary.json").read_text())
        returns = summary["returns"]
        row["mean"] = repr(statistics.fmean(returns))
        row["standard_error"] = repr(standard_error(returns))
        row["episodes"] = str(len(returns))
        row["arm"] = summary["auto"]["arm"]
    row["core_share"] = f"{cpu_seconds / wall_seconds:.2f}"
    return {**row, "wall_seconds": f"{wall_seconds:.1f}"}


def ended(child: subprocess.Popen[bytes]) -> tuple[int, float]:
    """The exit status and CPU seconds of a process, which is killed if it takes too long."""
    until = time.monotonic() + LIMIT_SECONDS
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            child.returncode = os.waitstatus_to_exitcode(status)
            return child.returncode, usage.ru_utime + usage.ru_stime
        if time.monotonic() > until:
            child.kill()
        time.sleep(0.05)


def standard_error(returns: list[float]) -> float:
    """That of the mean of the returns; 0 for a single one."""
    return statistics.stdev(returns) / math.sqrt(len(returns)) if len(returns) > 1 else 0.0


def set_floor(floor: Row, rows: list[Row]) -> None:
    """Sets the floor of a problem from its seeds' rows."""
    if any(row["cause"] or is_disturbed(row) for row in rows):
        said = "a run failed or had too little of its core: the floor is left"
        print(f"{floor['problem']}: {said}", file=sys.stderr)
        return
    means = [float(row["mean"]) for row in rows]
    error = max(float(row["standard_error"]) for row in rows)
    margin = max(max(means) - min(means), 2 * error, 0.01 * abs(min(means)))
    floor["floor"] = f"{min(means) - margin:.6g}"
    floor["means"] = " ".join(f"{mean:.6g}" for mean in means)
    floor["standard_error"] = f"{error:.3g}"
    floor["commit"] = rows[0]["commit"]


def is_below(row: Row, floor: Row) -> bool:
    """Whether the run failed or its return is below the floor."""
    return bool(row["cause"]) or float(row["mean"]) < float(floor["floor"])


def is_disturbed(row: Row) -> bool:
    """Whether other processes had much of its core."""
    return float(row["core_share"]) < LEAST_SHARE


def print_table(
    floors: list[Row], rows: dict[tuple[str, ...], Row], seed: int, fallen: list[Row]
) -> None:
    """The verdict on every problem; a second seed's return follows the first one's."""
    lines = [("problem", "kind", "floor", "return", "verdict")]
    for floor in floors:
        runs = [rows[key] for s in (seed, seed + 1) if (key := key_of(floor, s)) in rows]
        returned = ", ".join(f"{float(r['mean']):.6g}" if r["mean"] else r["cause"] for r in runs)
        name = f"{floor['problem']} {floor['instance']}"
        verdict = "FELL" if floor in fallen else "holds"
        if any(map(is_disturbed, runs)):
            verdict += ", with " + ", ".join(r["core_share"] for r in runs) + " of its core"
        lines.append((name, floor["kind"], floor["floor"], returned, verdict))
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    for line in lines:
        print("  ".join(part.ljust(width) for part, width in zip(line, widths, strict=True)))
    print(f"{len(floors) - len(fallen)} of {len(floors)} floors hold")


def described_commit() -> str:
    """The latest commit of the package, with a plus where files differ from it."""
    package = HERE.parent / "mdpo_rddl"

    def git(*arguments: str) -> str:
        command = ["git", *arguments, "--", str(package)]
        return subprocess.run(command, cwd=HERE, check=True, capture_output=True, text=True).stdout

    return git("log", "-1", "--format=%h").strip() + "+" * bool(git("status", "--porcelain"))


def key_of(floor: Row, seed: int) -> tuple[str, ...]:
    """Problem, instance and seed, which name a run."""
    return floor["problem"], floor["instance"], str(seed)


def row_key(row: Row) -> tuple[str, ...]:
    """The same of a run's row."""
    return row["problem"], row["instance"], row["seed"]


def read_rows(file: Path) -> list[Row]:
    """The rows of a CSV file; none where there is none."""
    if not file.exists():
        return []
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def write_rows(file: Path, columns: list[str], rows: list[Row]) -> None:
    """A CSV file of the rows."""
    with file.open("w", newline="") as lines:
        writer = csv.DictWriter(lines, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def add_row(file: Path, row: Row) -> None:
    """Adds a row at the end, below a header if the file is new."""
    file.parent.mkdir(parents=True, exist_ok=True)
    is_new = not file.exists()
    with file.open("a", newline="") as lines:
        writer = csv.DictWriter(lines, ROW_COLUMNS, lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(row)


if __name__ == "__main__":
    sys.exit(main())
