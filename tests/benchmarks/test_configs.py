"""Configurations found by the domain's name, and the sweep that chose ours."""

import csv
import math

import pytest
from helpers.problems import ROOT

from benchmarks.common.records import Records
from benchmarks.configs import sweep as config_sweep
from benchmarks.configs.candidates import candidates
from benchmarks.configs.choice import BASELINE, NOOP, REFERENCES, choose, mean_scores
from benchmarks.configs.names import PLANS, SCALES
from benchmarks.configs.sweep import (
    CHOSEN,
    COLUMNS,
    KEYS,
    Grid,
    config_sweep_table,
    run_config_sweep,
    shipped_text,
)
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets.by_domain import config_for_domain
from mdpo_rddl.problem.competition import REPOSITORY_NAMES

CONFIGS = ROOT / "mdpo_rddl" / "planner" / "config" / "shipped"
RUNS = ROOT / "results" / "configs" / "runs.csv"


def rows():
    with RUNS.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("domain", SCALES)
def test_what_is_shipped_is_what_the_sweep_chose(domain, plan):
    text = (CONFIGS / f"{domain}_ippc2023_{plan}.cfg").read_text(encoding="utf-8")
    assert text == shipped_text(rows(), domain, plan)
    found = config_for_domain(f"{domain}_ippc2023", "whatever", plan)
    assert found.sections == PlannerConfig.from_text(text).sections


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("domain", SCALES)
def test_what_is_shipped_was_as_good_as_jaxplan_s_own(domain, plan):
    scores = mean_scores(rows(), domain, plan)
    ours, theirs = scores[choose(rows(), domain, plan)], scores[BASELINE]
    assert ours.instances == theirs.instances
    assert ours.mean >= theirs.mean - math.hypot(ours.error, theirs.error)


def test_a_domain_is_found_by_the_name_in_its_file():
    for name, problem in REPOSITORY_NAMES.items():
        by_file = config_for_domain("domains/some.rddl", name, "slp")
        assert by_file == config_for_domain(problem, name, "slp")
        assert f"{problem}_slp.cfg" in by_file.source


def test_without_one_of_ours_jaxplan_s_own_is_found():
    own = config_for_domain("Wildfire_MDP_ippc2014", "wildfire_mdp", "drp")
    assert own.source == "JaxPlan's Wildfire_MDP_ippc2014_drp.cfg"
    default = config_for_domain("some/domain.rddl", "some", "replan")
    assert default.source == "JaxPlan's default_replan.cfg"


def test_a_path_that_ends_as_a_configuration_does_finds_none():
    for path in (f"{CONFIGS}/HVAC_ippc2023", "somewhere/Wildfire_MDP_ippc2014"):
        assert config_for_domain(path, "some", "drp").source == "JaxPlan's default_drp.cfg"


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("domain", SCALES)
def test_every_candidate_is_a_configuration(domain, plan):
    for config in candidates(domain, plan).values():
        assert PlannerConfig.from_text(config.to_text()).sections == config.sections


def made_up(folder, *found):
    records = Records(folder / "runs.csv", COLUMNS, KEYS)
    for instance, candidate, mean, error in found:
        status = "over 8 GB" if mean == "" else "ok"
        records.add("HVAC", instance, "drp", candidate, status, mean, error, 1, 0)
    return records


def on(instance, error=0, **returns):
    """Rows of one instance: the no-op scores 0."""
    names = {"theirs": BASELINE}
    tried = {NOOP: 0, **{names.get(name, name): mean for name, mean in returns.items()}}
    return [(instance, name, mean, error) for name, mean in tried.items()]


@pytest.mark.parametrize(
    ("found", "chosen"),
    [
        (on("1", theirs=5, jaxplan=5, low=9), "low"),
        # a little less on one instance, much more on another
        ([*on("1", theirs=5, jaxplan=5, low=4), *on("2", theirs=5, jaxplan=5, low=9)], "low"),
        # less on both together
        ([*on("1", theirs=8, jaxplan=8, low=9), *on("2", theirs=8, jaxplan=8, low=3)], "jaxplan"),
        # as little below as the evaluations tell apart
        (on("1", error=1, theirs=5, high=4, low=1), "high"),
        (on("1", error=0.1, theirs=5, high=4, low=1), "jaxplan"),
        # one that was tried on fewer instances
        ([*on("1", theirs=5, high=6, low=9), *on("2", theirs=5, high=6)], "high"),
        # JaxPlan's own failed
        (on("1", theirs="", jaxplan=5, low=6), "low"),
        (on("1", theirs=5, low=""), "jaxplan"),
    ],
)
def test_the_choice(tmp_path, found, chosen):
    records = made_up(tmp_path, *found)
    assert choose(records.rows, "HVAC", "drp") == chosen


def test_scores_worked_by_hand(tmp_path):
    found = [
        *(("1", NOOP, -100, 5), ("1", BASELINE, -40, 3), ("1", "low", -50, 4)),
        *(("1", "high", -150, 9), ("2", BASELINE, "", ""), ("2", NOOP, 2, 1), ("2", "low", 4, 1)),
    ]
    scores = mean_scores(made_up(tmp_path, *found).rows, "HVAC", "drp")
    assert scores[BASELINE] == (0.5, 3 / 60 / 2, 2)
    assert scores["low"].mean == pytest.approx((50 / 60 + 1) / 2)
    assert scores["low"].error == pytest.approx(math.hypot(4 / 60, 1 / 2) / 2)
    assert scores["high"] == (0.0, 9 / 60, 1)


def test_the_table_worked_by_hand(tmp_path):
    found = [("1", BASELINE, "", ""), ("1", "jaxplan", 5, 1), ("1", "low", -61234.5, 12)]
    names = [*REFERENCES, *candidates("HVAC", "drp")]
    cells = {BASELINE: "over 8 GB", "jaxplan": "**5.000 ± 1.000**", "low": "-61,234 ± 12"}
    assert config_sweep_table(made_up(tmp_path, *found)) == (
        f"| problem | instance | plan | {' | '.join(names)} |\n"
        f"|{'---|' * (len(names) + 3)}\n"
        f"| HVAC_ippc2023 | 1 | drp | {' | '.join(cells.get(name, '') for name in names)} |\n"
    )


def test_the_chosen_one_can_be_tried_on_more_instances(tmp_path, monkeypatch):
    records = made_up(tmp_path, ("1", BASELINE, 5, 1), ("1", "low", 9, 1), ("1", "high", 7, 1))
    monkeypatch.setattr(config_sweep, "Records", lambda *_: records)
    tried = []
    monkeypatch.setattr(config_sweep, "_run", lambda records, runs, limits: tried.extend(runs))
    grid = Grid(["HVAC"], ["1", "2"], names=[CHOSEN])
    run_config_sweep(tmp_path, grid, 1.0, 1, Limits(1, 1))
    assert [(run.instance, run.plan, run.candidate) for run in tried] == [
        ("1", "drp", NOOP),
        *(("2", "drp", NOOP), ("2", "drp", BASELINE), ("2", "drp", "low")),
        *(("1", "slp", NOOP), ("1", "slp", BASELINE), ("1", "slp", "jaxplan")),
        *(("2", "slp", NOOP), ("2", "slp", BASELINE), ("2", "slp", "jaxplan")),
    ]


def test_an_unknown_candidate_is_bad_input(tmp_path):
    grid = Grid(["HVAC"], ["1"], names=["none of them"])
    with pytest.raises(InputError, match="unknown candidate 'none of them', known are jaxplan"):
        run_config_sweep(tmp_path, grid, 1.0, 1, Limits(1, 1))
