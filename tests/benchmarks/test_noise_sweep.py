"""The sweep over the noise: a row for every run, stopped and resumed, and its table."""

from collections.abc import Iterator

import pytest
from helpers.toy_experiments import (
    OPTIONS,
    SETTINGS,
    SIZE,
    compiled_once,
    interrupt_training,
    nothing_to_do,
)

from benchmarks import main as bench
from benchmarks.common import full_training
from benchmarks.common.records import Records
from benchmarks.presets import noise_sweep
from benchmarks.presets.noise_sweep import NoisePoint, sweep, sweep_table

pytestmark = pytest.mark.long

GRID = [NoisePoint(0.5, 10.0), NoisePoint(2.0, 10.0)]
SWEEP = {"settings": SETTINGS, "grid": GRID, "size": SIZE}


@pytest.fixture(scope="module", autouse=True)
def toy() -> Iterator[None]:
    with compiled_once():
        yield


@pytest.fixture(scope="module")
def swept(toy, tmp_path_factory) -> Records:
    return sweep(tmp_path_factory.mktemp("sweep"), **SWEEP)


def test_the_sweep_has_a_row_for_every_combination_and_seed(swept):
    keys = [(row["alpha"], row["sigma_max"], row["restart"]) for row in swept.rows]
    assert keys == [(a, "10.0", s) for a in ("0.5", "2.0") for s in ("0", "1")]
    # every seed and every alpha has a result of its own
    assert len({row["last_return"] for row in swept.rows}) == 4
    assert Records(swept.path, noise_sweep.COLUMNS, noise_sweep.KEYS).rows == swept.rows


def test_the_order_of_the_sweep_does_not_matter(swept, tmp_path):
    # one compiled planner serves all combinations
    backwards = sweep(tmp_path, **SWEEP | {"grid": GRID[::-1]})
    assert backwards.rows == [*swept.rows[2:], *swept.rows[:2]]


def test_a_sweep_that_is_complete_trains_nothing(swept, monkeypatch):
    written = swept.path.read_bytes()
    monkeypatch.setattr(full_training, "train", nothing_to_do)
    monkeypatch.setattr(noise_sweep, "build_planner", nothing_to_do)
    again = sweep(swept.path.parent, **SWEEP)
    assert again.rows == swept.rows
    assert swept.path.read_bytes() == written


def test_a_sweep_stopped_in_a_training_records_nothing_of_it_and_goes_on(
    swept, tmp_path, monkeypatch
):
    with monkeypatch.context() as patch:
        interrupt_training(patch, 1)
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path, **SWEEP)
    stopped = Records(tmp_path / "sweep.csv", noise_sweep.COLUMNS, noise_sweep.KEYS)
    assert stopped.rows == swept.rows[:2]
    assert sweep(tmp_path, **SWEEP).rows == swept.rows
    assert (tmp_path / "sweep.csv").read_bytes() == swept.path.read_bytes()


def test_a_sweep_stopped_between_two_seeds_goes_on(swept, tmp_path, monkeypatch):
    evaluations: list[int] = []

    def evaluate(env, policy, episodes, seed):
        evaluations.append(seed)
        if len(evaluations) == 2:
            raise KeyboardInterrupt
        return noise_sweep_evaluate(env, policy, episodes, seed)

    noise_sweep_evaluate = noise_sweep.evaluate
    with monkeypatch.context() as patch:
        patch.setattr(noise_sweep, "evaluate", evaluate)
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path, **SWEEP)
    stopped = Records(tmp_path / "sweep.csv", noise_sweep.COLUMNS, noise_sweep.KEYS)
    assert stopped.rows == swept.rows[:1]
    assert evaluations == [0, 1]  # each restart is evaluated with a seed of its own
    assert sweep(tmp_path, **SWEEP).rows == swept.rows


def test_the_sweep_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "sweep.csv", noise_sweep.COLUMNS, noise_sweep.KEYS)
    for row in [
        ("powergen7", 2.0, 10.0, 0, 1000.0),
        ("powergen7", 2.0, 10.0, 1, 3000.0),  # mean 2000, deviations 1000: sqrt(2e6 / 1)
        ("powergen7", 0.5, 10.0, 0, -7.4),
        ("hvac10", 0.5, 10.0, 0, -1e6),
        ("hvac10", 0.5, 10.0, 1, -2e6),
        ("hvac10", 0.5, 10.0, 2, -3e6),
        ("hvac10", 4.0, 9.0, 0, 0.0),
    ]:
        records.add(*row)
    assert sweep_table(records) == (
        "| sigma_max | alpha | powergen7 | hvac10 |\n"
        "|---|---|---|---|\n"
        "| 9 | 4 |  | 0 ± 0 |\n"
        "| 10 | 0.5 | -7 ± 0 | -2,000,000 ± 1,000,000 |\n"
        "| 10 | 2 | 2,000 ± 1,414 |  |\n"
    )


def test_bench_sweeps_the_noise(swept, tmp_path, capsys):
    options = ["--alphas", "0.5", "2", "--sigma-maxes", "10", "--out", str(tmp_path)]
    assert bench.main(["noise-sweep", *OPTIONS, *options]) == 0
    assert (tmp_path / "sweep.csv").read_bytes() == swept.path.read_bytes()
    assert capsys.readouterr().out == sweep_table(swept)
    assert (tmp_path / "table.md").read_text(encoding="utf-8") == sweep_table(swept)
