"""What noise is worth: cells that are measured once, their statistics and the report."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import tiny_files
from jax import random
from scipy import stats

from benchmarks import main as bench
from benchmarks.noise_value import problems, run
from benchmarks.noise_value.cells import Cell, is_missing, load, save
from benchmarks.noise_value.compared import BESIDE, returns_of
from benchmarks.noise_value.cost import SECTIONS, cost_path
from benchmarks.noise_value.lanes import (
    TooLongError,
    Trained,
    best_curve,
    best_of,
    train_lanes,
)
from benchmarks.noise_value.methods import (
    DEFAULT,
    METHODS,
    NONE,
    has_pgpe,
    lanes,
    task_config,
)
from benchmarks.noise_value.names import DEFAULT_SIGMA
from benchmarks.noise_value.report import write_report
from benchmarks.noise_value.rule import Case, find_rule
from benchmarks.noise_value.run import all_cells, common_unit
from benchmarks.noise_value.signs import SIGNS
from benchmarks.noise_value.statistics import holm, normalised, stratified_mean, t_test_p
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.executors import make_executor
from mdpo_rddl.noise import ConstantNoise, default_noise
from mdpo_rddl.noise.actions import ActionKind, ActionSpec
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.problem.load import load_problem

SIZES = {"seeds": 2, "iterations": 4, "max_horizon": 3, "rollouts": 40}
SIGN_VALUES = dict.fromkeys(SIGNS, 0.0)


def cell(out: Path, problem: str = "Toy", **others) -> Cell:
    names = {"problem": problem, "instance": "1", "plan": "slp", "configuration": "no-pgpe"}
    return Cell(out, **names, **{**SIZES, **others})


def test_all_seeds_are_parallel_updates_of_jaxplan_s_configuration():
    config = task_config("Reservoir_ippc2023", "slp", "no-pgpe", seeds=5)
    planner = config.section("Planner")
    assert (planner["parallel_updates"], planner["pgpe"]) == (5, None)
    assert has_pgpe(task_config("Reservoir_ippc2023", "slp", "own", 1))
    assert not has_pgpe(task_config("PowerGen_Continuous", "slp", "own", 1))


def test_a_configuration_without_pgpe_is_measured_once():
    problems = [("HVAC_ippc2023", "1"), ("PowerGen_Continuous", "0")]
    cells = all_cells(problems, ["slp"], ["own", "no-pgpe"], out=Path(), **SIZES)
    assert [(c.problem, c.configuration) for c in cells] == [
        ("HVAC_ippc2023", "own"),
        ("HVAC_ippc2023", "no-pgpe"),
        ("PowerGen_Continuous", "no-pgpe"),
    ]


def test_the_rules_of_all_trainings_are_one_program():
    rules = [lane.rule() for lane in lanes(DEFAULT_SIGMA).values() if lane.unit == "range"]
    assert len({str(jax.tree.structure(rule)) for rule in rules}) == 1
    assert not any(rule.silent for rule in rules)
    gradients = {"a": jnp.array([[1.0], [0.0]])}
    profile = {
        name: lane.rule().profile(gradients, jnp.zeros(()), 2)[0].sigma
        for name, lane in lanes(DEFAULT_SIGMA).items()
    }
    np.testing.assert_allclose(profile["none"], [0.0, 0.0])
    np.testing.assert_allclose(profile["constant"], [0.1, 0.1])
    np.testing.assert_allclose(profile["adaptive"], [0.1, 0.0], rtol=1e-6)
    np.testing.assert_allclose(profile["annealed companion"], [0.3, 0.0], rtol=1e-6)
    in_range = lanes(DEFAULT_SIGMA)["paper"].in_range_units(4.0)
    np.testing.assert_allclose(in_range.profile(gradients, 0.0, 2)[0].sigma, [2.5, 0.0])


def test_the_default_of_the_report_is_the_planner_s():
    alone, companion = METHODS[DEFAULT]
    lane = lanes(DEFAULT_SIGMA)[companion]
    assert alone == NONE
    assert (lane.sigma_min, lane.anneals) == (lane.sigma_max, False)
    assert default_noise() == ConstantNoise(lane.sigma_max, lane.unit, paired=True)


def test_which_second_trainings_begin_elsewhere_is_told(tmp_path):
    trained = lanes(DEFAULT_SIGMA)
    assert {trained[names[1]].stream for names in METHODS.values() if len(names) > 1} == {1}
    assert {trained[name].stream for name in (NONE, *BESIDE.values())} == {0}
    said = write_report(tmp_path)
    assert "other initial parameters in `none-twice`, `annealed beside`, `constant beside`" in said
    assert "with the same in `adaptive beside`, `paper beside`, which are not to be" in said


def test_units_are_common_where_all_components_have_the_same():
    def spec(unit, **others):
        return ActionSpec("a", np.shape(unit), ActionKind.REAL, 0.0, 1.0, unit=unit, **others)

    assert common_unit({"a": spec(np.full(2, 3.0)), "b": spec(np.array(3.0))}) == 3.0
    assert common_unit({"a": spec(np.array([1.0, 2.0]))}) is None
    assert common_unit({"a": spec(np.array(1.0), squashed=True)}) is None


@pytest.mark.long
def test_cells_are_trained_once_and_reported(tmp_path, monkeypatch, capsys):
    files = tiny_files(tmp_path, horizon=4, spread=0.1)
    toy = load_problem(*files, 3)
    monkeypatch.setattr(run, "load_problem", lambda *names: toy)
    monkeypatch.setattr(problems, "named_instance", lambda name: tuple(name.split(":")))
    out = tmp_path / "out"
    arguments = ["noise-value", "--problems", "Toy:1", "--plans", "slp", "--configurations"]
    arguments += ["no-pgpe", "--seeds", "2", "--iterations", "4", "--max-horizon", "3"]
    arguments += ["--rollouts", "40", "--out", str(out)]
    assert bench.main(arguments) == 0
    assert "| Toy | 1 | slp | no-pgpe |" in capsys.readouterr().out
    kept = load(cell(out))
    assert kept["units"] == {"push": [2.0, 2.0]}  # the box is from -1 to 1
    assert set(kept["signs"]) == set(SIGNS)
    found = kept["methods"]
    assert {len(found[name]["returns"]) for name in METHODS} == {2}
    assert len(found["none"]["curves"][0]) == len(kept["curve_iterations"]) == 4
    assert (np.array(found[DEFAULT]["tested"]) >= found["none"]["tested"]).all()
    assert found["paper"]["returns"] != found["none"]["returns"]

    # without noise it is JaxPlan's training
    config = task_config("Toy", "slp", "no-pgpe", 2).with_section("Noise", {"method": "NoNoise"})
    built = build_planner(toy, config)
    plain = train_lanes(built, random.PRNGKey(0), 4, 2)
    np.testing.assert_allclose(plain.best, found["none"]["tested"], rtol=1e-5)
    with pytest.raises(TooLongError, match="a training would take"):
        train_lanes(built, random.PRNGKey(0), 10**6, 2, most_seconds=1e-6)

    monkeypatch.setattr(run, "_measure", None)  # there is nothing left to do
    run.run_noise_value([cell(out)], make_executor("local", {}))
    with pytest.raises(InputError, match="was made with another seeds"):
        load(cell(out, seeds=3))


def test_what_fails_is_kept_as_a_finding(tmp_path, monkeypatch):
    def fail(cell):
        raise ValueError("no such thing")

    monkeypatch.setattr(run, "_measure", fail)
    run.run_cell(cell(tmp_path))
    assert load(cell(tmp_path))["status"] == "no such thing"
    assert "Not measured: Toy 1, slp, no-pgpe (no such thing)." in write_report(tmp_path)


def test_what_would_take_too_long_is_left_out_until_it_has_more_time(tmp_path, monkeypatch):
    def refuse(cell):
        raise TooLongError("a training would take 99 s of CPU time")

    monkeypatch.setattr(run, "_measure", refuse)
    run.run_cell(cell(tmp_path, most_seconds=50.0))
    assert "(left out: a training would take 99 s of CPU time)" in write_report(tmp_path)
    assert not is_missing(cell(tmp_path, most_seconds=50.0))
    assert is_missing(cell(tmp_path, most_seconds=60.0))


def test_of_two_trainings_a_seed_keeps_the_better_tested_one():
    def trained(best):
        zeros = np.zeros(2)
        curves = np.array(best)[:, np.newaxis]
        return Trained(None, np.array(best), curves, zeros, zeros, zeros, zeros, zeros, 1.0)

    pair = [trained([1.0, 5.0]), trained([2.0, 5.0])]
    values = [np.array([10.0, 20.0]), np.array([30.0, 40.0])]
    np.testing.assert_array_equal(best_of(pair, values), [30.0, 20.0])
    np.testing.assert_array_equal(best_curve(pair), [[2.0], [5.0]])


def result(returns: dict[str, list[float]], signs: dict[str, float] | None = None) -> dict:
    base = {name: returns.get(name, returns["none"]) for name in METHODS}
    methods = {
        name: {"returns": values, "tested": values, "curves": [[0.0, v] for v in values]}
        for name, values in base.items()
    }
    found = {"status": "ok", "noop": 0.0, "curve_iterations": [0, 9], "methods": methods}
    return {**found, "signs": {**SIGN_VALUES, **(signs or {})}}


def test_the_report_says_where_noise_is_better_and_worse(tmp_path):
    for problem, lead in (("Gains", 5.0), ("Loses", -5.0), ("Same", 0.0)):
        base = np.array([10.0, 11.0, 12.0])
        ours = base + lead + np.array([0.0, 0.01, -0.01]) * bool(lead)
        kept = result({"none": base.tolist(), DEFAULT: ours.tolist()})
        save(cell(tmp_path, problem, seeds=3), kept)
    text = write_report(tmp_path)
    assert (tmp_path / "table.md").read_text() == text
    assert (tmp_path / "strips.png").stat().st_size > 0
    assert (tmp_path / "curves.png").stat().st_size > 0
    lines = text.splitlines()
    row = next(line for line in lines if line.startswith(f"| {DEFAULT}"))
    assert row.split("|")[2].strip() == "3"
    assert [part.strip() for part in row.split("|")[4:8]] == ["1", "1", "1", "1"]
    assert "| Gains | 1 | slp | no-pgpe | 0 | 11 | 11 | 11 | 11 | 16 \\* | 11 | 11 |" in lines
    assert "Costs: not measured." in lines
    assert "by less than a thousandth" not in text


def test_the_report_says_which_differences_are_too_small_to_matter(tmp_path):
    base = np.array([1000.0, 1001.0, 1002.0])
    ours = base - np.array([0.5, 0.501, 0.499])
    save(cell(tmp_path, "Near", seeds=3), result({"none": base.tolist(), DEFAULT: ours.tolist()}))
    text = write_report(tmp_path)
    assert f"Of these, by less than a thousandth of the return: `{DEFAULT}` 1 of 1." in text


def test_beside_an_update_without_noise_a_seed_keeps_the_better_tested_one():
    kept = result({"none": [10.0, 10.0], "adaptive": [20.0, 5.0]})
    np.testing.assert_array_equal(returns_of(kept, "adaptive beside"), [20.0, 10.0])
    kept["methods"]["adaptive"]["tested"] = [0.0, 30.0]  # the test need not be right
    np.testing.assert_array_equal(returns_of(kept, "adaptive beside"), [10.0, 5.0])


def test_costs_are_ratios_to_no_noise(tmp_path):
    for number, ratio in enumerate((2.0, 2.5, 4.0)):
        path = cost_path(cell(tmp_path, f"Toy{number}"))
        path.parent.mkdir(exist_ok=True)
        kept = {"ratio": {**dict.fromkeys(SECTIONS, 1.0), "default": ratio}}
        kept["iteration_ms"] = dict.fromkeys(SECTIONS, 1.0)
        kept["compile_seconds"] = {**dict.fromkeys(SECTIONS, 4.0), "default": 6.0}
        path.write_text(json.dumps(kept))
    text = write_report(tmp_path)
    assert "| default | 2.50 (2.00 to 4.00) | 1.50 (1.50 to 1.50) |" in text
    path.write_text("{}")
    with pytest.raises(InputError, match="holds no costs"):
        write_report(tmp_path)


def cases_of(family: str, pairs: list[tuple[float, float]]) -> list[Case]:
    return [Case(family, {**SIGN_VALUES, "gap": gap}, lead) for gap, lead in pairs]


def test_the_rule_is_a_threshold_found_on_one_half_and_tested_on_the_other():
    known = cases_of("HVAC", [(0.1, 0.0), (0.2, 0.0), (0.6, 0.3), (0.8, 0.2)])
    rule = find_rule(known)
    assert (rule.sign, rule.above) == ("gap", True)
    assert rule.threshold == pytest.approx(0.4)
    assert rule.hits(known) == 4
    assert rule.hits(cases_of("UAV", [(0.9, 0.0), (0.9, 0.1), (0.3, 0.0)])) == 2
    assert "`gap`" in str(rule)


def test_where_noise_never_pays_the_rule_says_nowhere():
    rule = find_rule(cases_of("HVAC", [(0.1, 0.0), (0.6, 0.005)]))
    assert str(rule) == "nowhere"


def test_the_problems_of_a_family_are_held_out_together():
    held_out = {name: Case(name, SIGN_VALUES, 0.0).is_held_out for name in ("HVAC", "UAV")}
    assert held_out == {"HVAC": True, "UAV": False}


def test_the_paired_test_is_student_s():
    ours, theirs = np.array([1.0, 2.0, 4.0, 3.5]), np.array([0.5, 2.1, 3.0, 3.0])
    assert t_test_p(ours, theirs) == pytest.approx(stats.ttest_rel(ours, theirs).pvalue)
    assert t_test_p(ours, ours) == 1.0
    assert t_test_p(ours, ours * (1.0 + 2e-7)) == 1.0  # rounding, the same for all seeds
    assert t_test_p(ours, ours - 1.0) == 0.0


def test_holm_worked_by_hand():
    # sorted 0.01 0.02 0.03 0.5, times 4 3 2 1, never falling
    np.testing.assert_allclose(holm([0.03, 0.01, 0.5, 0.02]), [0.06, 0.04, 0.5, 0.06])


def test_scores_are_0_at_the_no_op_and_1_at_the_best_mean():
    scores = normalised({"a": np.array([5.0, 15.0]), "b": np.array([-10.0, 5.0])}, 0.0)
    np.testing.assert_allclose(scores["a"], [0.5, 1.0])
    np.testing.assert_allclose(scores["b"], [0.0, 0.5])
    assert not np.any(normalised({"a": np.array([-1.0])}, 0.0)["a"])


def test_the_interval_resamples_the_seeds_of_each_problem():
    mean, low, high = stratified_mean([np.full(5, 0.2), np.full(5, 0.6)])
    assert (mean, low, high) == pytest.approx((0.4, 0.4, 0.4))
    mean, low, high = stratified_mean([np.array([0.0, 1.0])])
    assert (mean, low, high) == pytest.approx((0.5, 0.0, 1.0))


@pytest.mark.parametrize("shard", ["2/2", "3/2", "1", "a/b"])
def test_a_shard_that_is_none(shard, capsys):
    with pytest.raises(SystemExit):
        bench.main(["noise-value", "--shard", shard])
    assert "must be I/N" in capsys.readouterr().err


def test_an_unknown_problem_is_named():
    with pytest.raises(InputError, match="has no problem 'Nowhere'"):
        problems.with_instances(["Nowhere"])


def test_the_competition_s_problems_have_five_instances():
    assert problems.with_instances(["HVAC_ippc2023"]) == [("HVAC_ippc2023", n) for n in "12345"]
    assert problems.with_instances(["Elevators:0"]) == [("Elevators", "0")]


def test_a_problem_that_stands_twice_in_the_repository_is_measured_once():
    names = [name for name, _ in problems.with_instances(None)]
    assert "CrossingTraffic_MDP_ippc2011" in names  # 2014 has the same two files
    assert "CrossingTraffic_MDP_ippc2014" not in names
    assert "TriangleTireworld_MDP_ippc2014" in names
    by_name = problems.with_instances(["CrossingTraffic_MDP_ippc2014"])
    assert by_name == [("CrossingTraffic_MDP_ippc2014", "1")]


def test_another_sigma_is_another_measurement(tmp_path):
    assert lanes(0.3)["constant companion"].sigma_max == 0.3
    assert lanes(0.3)[NONE] == lanes(DEFAULT_SIGMA)[NONE]
    save(cell(tmp_path), {"status": "error"})
    with pytest.raises(InputError, match="another trainings; use another --out"):
        is_missing(cell(tmp_path, sigma=0.3))


@pytest.mark.long
def test_the_committed_cells_can_be_gone_on_with():
    folder = Path(__file__).parents[2] / "results" / "noise_value"
    for file in sorted((folder / "cells").iterdir()):
        kept = json.loads(file.read_text())["conditions"]
        sizes = {name: kept[name] for name in Cell.__dataclass_fields__ if name in kept}
        committed = Cell(folder, **sizes)
        assert committed.path == file
        assert load(committed) is not None
