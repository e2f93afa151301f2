"""More time to prepare: what is run, and where a longer preparation found less."""

import numpy as np

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.tasks.anytime import anytime_table, falls, read_anytime
from benchmarks.tasks.trial import COLUMNS, KEYS, Task


def test_every_time_has_its_rows_and_is_tried_once(tmp_path, monkeypatch, capsys):
    asked = []

    def run(out, tasks, planners, seeds, conditions):
        asked.append((out.name, conditions.seconds, list(tasks), seeds))
        records = Records(out / "rows.csv", COLUMNS, KEYS)
        row = {"status": "ok", "mean": conditions.seconds}
        for seed in range(seeds):
            records.add(
                "TSP_or", "0", "mdpo", seed, *(row.get(n, "") for n in COLUMNS[len(KEYS) :])
            )

    monkeypatch.setattr("benchmarks.tasks.anytime.run_tasks", run)
    words = ["anytime", "--problems", "TSP_or:0", "--seconds", "5", "2.5", "--seeds", "2"]
    assert bench.main([*words, "--out", str(tmp_path)]) == 0
    tasks = [Task("TSP_or", "0")]
    assert asked == [("5", 5.0, tasks, 2), ("2.5", 2.5, tasks, 2)]
    assert "| TSP_or | 0 | 2 | 2.5 [2.5, 2.5] | 5 [5, 5] |  |" in capsys.readouterr().out
    assert (tmp_path / "anytime.png").stat().st_size > 0
    (times,) = read_anytime(tmp_path).values()
    assert list(times) == [2.5, 5.0]  # though the longer one came first


def test_a_median_falls_where_it_is_below_all_seeds_of_a_shorter_time():
    times = {
        5.0: np.array([1.0, 2.0, 3.0]),
        10.0: np.array([0.0, 1.5, 9.0]),  # within
        20.0: np.array([0.0, 0.9, 9.0]),  # below the smallest of 5 s
        45.0: np.array([-np.inf, 0.5, 0.6]),
    }
    assert falls(times) == [(5.0, 20.0), (5.0, 45.0)]
    table = anytime_table({Task("Toy", "1"): times})
    assert "| 5 to 20 s, 5 to 45 s |" in table
    assert table.endswith("falls below the interval of a shorter time on 1 of 1 tasks.\n")
