"""Scores of a run, worked by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.mistakes import one_line

from mdpo_rddl.ipc.conditions import CONDITIONS, keep_conditions
from mdpo_rddl.ipc.published import SCORES, published_score
from mdpo_rddl.ipc.report import JSON, MARKDOWN, write_report
from mdpo_rddl.ipc.results import EntryResult, Preparation, Trial, load_results, parse_preparation
from mdpo_rddl.ipc.rules import Entry, Instance, Rules
from mdpo_rddl.ipc.score import normalise, score

READY = Preparation("ok", "", 1.0, 100.0)
HVAC, HVAC2, UAV = (
    Instance("HVAC_ippc2023", "1"),
    Instance("HVAC_ippc2023", "2"),
    Instance("UAV_ippc2023", "1"),
)
PLANNERS = ("mdpo", "jaxplan-slp", "noop", "random")


def result(problem, planner, totals, **last):
    """An entry with these returns; what is given besides is of its last trial."""
    trials = [Trial(i, "ok", "", float(total), 10, 0, 0.1) for i, total in enumerate(totals)]
    if last:
        values = {**vars(trials[-1]), **last}
        trials[-1] = Trial(**values)
    return EntryResult(Entry(problem, planner), len(totals), READY, tuple(trials))


def of(problem, mdpo, slp, noop=0.0, random=-10.0):
    """Entries of one instance, two trials each; numbers are mean returns."""
    returns = {"mdpo": mdpo, "jaxplan-slp": slp, "noop": noop, "random": random}
    return [result(problem, name, [mean - 1, mean + 1]) for name, mean in returns.items()]


@pytest.mark.parametrize(
    ("mean", "floor", "best", "expected"),
    [
        (5.0, 0.0, 10.0, 0.5),
        (10.0, 0.0, 10.0, 1.0),
        (-3.0, 0.0, 10.0, 0.0),
        (-150.0, -200.0, -100.0, 0.5),
        (None, 0.0, 10.0, 0.0),
        (0.0, 0.0, 0.0, 0.0),
        (5.0, None, 10.0, None),
    ],
)
def test_the_normalised_score(mean, floor, best, expected):
    assert normalise(mean, floor, best) == expected


def test_domains_and_the_run_are_means_of_means():
    results = [*of(HVAC, 10, 5), *of(HVAC2, 4, 8), *of(UAV, -1, 20, noop=-5, random=10)]
    found = score(results, "strict", PLANNERS)
    assert found.cells[HVAC]["jaxplan-slp"].normalised == 0.5
    # the floor is the better of the two, and nothing below it is worth less than 0
    assert found.cells[UAV]["mdpo"].normalised == 0.0
    assert found.domains["HVAC_ippc2023"] == {
        "mdpo": 0.75,
        "jaxplan-slp": 0.75,
        "noop": 0.0,
        "random": 0.0,
    }
    assert found.overall["mdpo"] == pytest.approx((0.75 + 0.0) / 2)
    assert found.overall["jaxplan-slp"] == pytest.approx((0.75 + 1.0) / 2)
    assert found.count("mdpo", best_only=True) == 1
    assert found.count("jaxplan-slp", best_only=True) == 2


def test_the_better_of_two_is_taken_instance_by_instance():
    results = [*of(HVAC, 10, 5), *of(HVAC2, 4, 8), *of(UAV, 2, 20)]
    found = score(results, "strict", PLANNERS)
    expected = ((1.0 + 1.0) / 2 + 1.0) / 2
    assert found.better_of(["mdpo", "jaxplan-slp"]) == expected
    assert found.better_of(["mdpo"]) == found.overall["mdpo"]
    assert found.better_of(["mdpo", "jaxplan-drp"]) is None


def test_whose_interval_holds_the_best_mean_is_level_with_it():
    # Student's interval of [3, 5] is 4 +- 12.7; of [4, 4] it is a point
    results = [*of(HVAC, 8, 4), result(UAV, "mdpo", [8, 8]), result(UAV, "jaxplan-slp", [4, 4])]
    found = score(results, "strict", PLANNERS)
    assert found.cells[HVAC]["jaxplan-slp"].interval == pytest.approx((4 - 12.7062, 4 + 12.7062))
    assert found.cells[HVAC]["jaxplan-slp"].is_level
    assert not found.cells[UAV]["jaxplan-slp"].is_level
    assert (found.count("mdpo"), found.count("jaxplan-slp")) == (2, 1)
    assert found.count("jaxplan-slp", best_only=True) == 0


@pytest.mark.parametrize("status", ["error", "illegal", "non-finite", "timeout", "memory", "crash"])
def test_a_failed_trial_scores_the_instance_0_and_marks_no_best(status):
    results = of(HVAC, 10, 5)
    results[0] = result(HVAC, "mdpo", [9, 99], status=status, cause="why", total=None)
    for mode in ("strict", "lenient"):
        row = score(results, mode, PLANNERS).cells[HVAC]
        assert (row["mdpo"].normalised, row["mdpo"].mean, row["mdpo"].is_level) == (
            0.0,
            None,
            False,
        )
        assert row["mdpo"].failure == f"trial 1: {status}: why"
        assert row["mdpo"].failed_trials == 1
        assert row["jaxplan-slp"].normalised == 1.0
        assert row["jaxplan-slp"].is_best


def test_trials_that_were_never_played_have_failed_too():
    dead = Trial(0, "crash", "killed by SIGKILL", None, 0, 0, 0.1)
    results = of(HVAC, 10, 5)
    results[0] = EntryResult(Entry(HVAC, "mdpo"), 50, READY, (dead,))
    assert score(results, "strict", PLANNERS).cells[HVAC]["mdpo"].failed_trials == 50
    unready = Preparation("timeout", "over 60 s", 60.0, 100.0)
    results[0] = EntryResult(Entry(HVAC, "mdpo"), 50, unready)
    cell = score(results, "strict", PLANNERS).cells[HVAC]["mdpo"]
    assert (cell.failed_trials, cell.normalised) == (50, 0.0)
    assert cell.failure == "preparation: timeout: over 60 s"


def test_a_broken_precondition_counts_in_the_strict_score_alone():
    results = of(HVAC, 10, 5)
    results[0] = result(HVAC, "mdpo", [9, 11], violations=7)
    strict = score(results, "strict", PLANNERS).cells[HVAC]
    assert strict["mdpo"].failure == "trial 1: 7 illegal actions"
    assert (strict["mdpo"].normalised, strict["jaxplan-slp"].normalised) == (0.0, 1.0)
    lenient = score(results, "lenient", PLANNERS).cells[HVAC]
    assert (lenient["mdpo"].normalised, lenient["jaxplan-slp"].normalised) == (1.0, 0.5)
    assert strict["mdpo"].violations == lenient["mdpo"].violations == 7


def test_what_has_not_ended_is_not_scored():
    results = of(HVAC, 10, 5)
    whole = results[0]
    results[0] = EntryResult(whole.entry, 3, READY, whole.trials)
    found = score(results, "strict", PLANNERS)
    assert "mdpo" not in found.cells[HVAC]
    assert "mdpo" not in found.overall
    assert found.overall["jaxplan-slp"] == 1.0


def test_an_instance_on_which_the_floor_fails_is_left_out():
    failing = [
        result(HVAC2, name, [1, 1], status="error", cause="it fails") for name in ("noop", "random")
    ]
    playing = [result(HVAC2, "mdpo", [3, 3]), result(HVAC2, "jaxplan-slp", [1, 1], status="error")]
    found = score([*of(HVAC, 10, 5), *failing, *playing], "strict", PLANNERS)
    assert found.overall == found.domains["HVAC_ippc2023"]
    assert found.overall["jaxplan-slp"] == 0.5
    assert found.better_of(["mdpo", "jaxplan-slp"]) == 1.0
    # where it is all that there is, there is no score
    found = score([*failing, *playing], "strict", PLANNERS)
    assert (found.overall, found.better_of(["mdpo"])) == ({}, None)


def test_without_a_floor_there_is_no_normalised_score():
    found = score(of(HVAC, 10, 5)[:2], "strict", PLANNERS[:2])
    assert found.cells[HVAC]["mdpo"].normalised is None
    assert found.cells[HVAC]["mdpo"].is_best
    assert found.overall == {}


# --- the report ------------------------------------------------------------------------------


def written_run(folder, results, lenient=True):
    keep_conditions(folder, Rules(trials=2, lenient=lenient), {"cores": 2})
    for each in results:
        each.save(folder)


def written(folder, results, lenient=True):
    written_run(folder, results, lenient)
    return write_report(folder)


def test_the_report_shows_both_scores_and_the_published_ones(tmp_path):
    results = [*of(HVAC, 10, 5), *of(UAV, 3, 20)]
    results[0] = result(HVAC, "mdpo", [9, 11], violations=7)
    text = written(tmp_path, results)
    assert (tmp_path / MARKDOWN).read_text() == text
    heads = "planner | strict score | lenient score | best | best or level"
    assert f"| {heads} | failed instances | failed trials | illegal actions |" in text
    assert "| mdpo | 0.075 | 0.575 | 0 | 0 of 2 | 1 | 1 | 7 |" in text
    assert "| jaxplan-slp | 1.000 | 0.750 | 2 | 2 of 2 | 0 | 0 | 0 |" in text
    assert "| HVAC_ippc2023 1 | failed | **5 ± 12.71** | 0 ± 12.71 | -10 ± 12.71 |" in text
    assert "- HVAC_ippc2023 1, mdpo: 1 trials failed; trial 1: 7 illegal actions" in text
    assert "- HVAC_ippc2023 1: failed; best is jaxplan-slp with 5 ± 12.71" in text
    assert "- UAV_ippc2023 1: 3 ± 12.71; best is jaxplan-slp with 20 ± 12.71" in text
    assert "of other runs" in text
    assert "| HVAC_ippc2023 1 | 0.000 | 0.779 | 0.822 | 1.000 |" in text
    for name in ("domains.png", "profiles.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    values = json.loads((tmp_path / JSON).read_text())
    assert values["strict"]["overall"]["mdpo"] == pytest.approx(0.075)
    assert values["lenient"]["best"]["mdpo"] == 1
    assert values["conditions"]["trials"] == 2
    assert load_results(tmp_path) == sorted(results, key=str_path)


def test_a_problem_s_name_is_no_formula(tmp_path):
    written(tmp_path, of(Instance(r"x$\foo$.rddl", "1"), 10, 5))
    for name in ("domains.png", "profiles.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_names_of_strangers_obey_and_forge_nothing(tmp_path):
    odd = "\x1b]0;mine\x07\n## Overall"
    results = of(Instance(f"{odd}.rddl", "1"), 10, 5)
    results[0] = replace(results[0], entry=Entry(results[0].entry.problem, f"a:{odd}"))
    text = written(tmp_path, results)
    assert "\x1b" not in text
    assert text.count("\n## Overall") == 1
    assert "a:\\x1b]0;mine\\x07\\n## Overall" in text


def test_a_picture_of_many_domains_shows_the_first(tmp_path):
    many = [each for n in range(300) for each in of(Instance(f"d{n}", "1"), 10, 5)]
    written(tmp_path, many)
    width = int.from_bytes((tmp_path / "domains.png").read_bytes()[16:20])
    assert width == 1.4 * 60 * 130


def str_path(result):
    return result.entry.problem.domain, result.entry.problem.instance, result.entry.planner


def test_a_strict_run_has_one_score(tmp_path):
    text = written(tmp_path, of(HVAC, 10, 5), lenient=False)
    assert "| planner | strict score | best |" in text
    assert "lenient" not in json.loads((tmp_path / JSON).read_text())


def test_the_report_has_jaxplans_better_one_and_the_remarks(tmp_path):
    (tmp_path / "run").mkdir()
    run = tmp_path / "run"
    written(run, [*of(HVAC, 10, 5), result(HVAC, "jaxplan-drp", [7, 9])])
    (run / "remarks.md").write_text("Lost for want of time.\n")
    text = write_report(run)
    assert "| JaxPlan's better one on each instance | 0.800 | 0.800 |" in text
    assert "## Remarks\n\nLost for want of time.\n\n##" in text
    assert json.loads((run / JSON).read_text())["strict"]["jaxplan_better_of_two"] == 0.8


def test_an_unfinished_run_says_so(tmp_path):
    results = of(HVAC, 10, 5)
    results[0] = EntryResult(results[0].entry, 2, READY)
    assert "not finished, and not scored: 1." in written(tmp_path, results)


def test_a_cause_that_utf8_cannot_hold_costs_nobody_the_report(tmp_path):
    results = of(HVAC, 10, 5)
    results[0] = result(HVAC, "mdpo", [9, 99], status="error", cause="Exception: \ud800")
    assert "trial 1: error: Exception: \\ud800" in written(tmp_path, results)
    unready = parse_preparation({**vars(READY), "status": "error", "cause": "\ud800"})
    assert unready.cause == "\\ud800"
    odd = Instance("\udcff.rddl", "\udcfe")  # a file's name that is not in UTF-8
    text = written(tmp_path, [*results, result(odd, "noop", [1, 2])])
    assert "\\udcff \\udcfe" in text


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        (CONDITIONS, "{", "{path}: is not JSON"),
        (CONDITIONS, "[]", "{path}: is not a run's conditions"),
        ("entries/HVAC_ippc2023/1/mdpo.json", "{}", "{path}: is not the result of an entry"),
        ("entries/HVAC_ippc2023/1/mdpo.json", "no", "{path}: is not the result of an entry"),
    ],
)
def test_a_damaged_file_is_named(tmp_path, name, content, complaint):
    written(tmp_path, of(HVAC, 10, 5))
    (tmp_path / name).write_text(content)
    message = one_line(lambda: write_report(tmp_path))
    assert message.startswith(complaint.format(path=tmp_path / name))


ENTRY = "entries/HVAC_ippc2023/1/mdpo.json"


@pytest.mark.parametrize(
    ("name", "keys", "value", "complaint"),
    [
        (CONDITIONS, ["plan_seconds"], "x", "plan_seconds is 'x', not a number above 0"),
        (CONDITIONS, ["memory_gb"], float("inf"), "memory_gb is inf, not a number above 0"),
        (CONDITIONS, ["trials"], 10.5, "trials is 10.5, not a whole number above 0"),
        (CONDITIONS, ["seed"], float("nan"), "seed is nan, not a whole number"),
        (CONDITIONS, ["lenient"], 1, "lenient is 1, not true or false"),
        (CONDITIONS, ["versions", "jax"], float("nan"), "'versions' is {"),
        (ENTRY, ["wanted"], float("inf"), "wanted is inf"),
        (ENTRY, ["wanted"], 0, "wanted is 0"),
        (ENTRY, ["entry", "planner"], [], "planner is []"),
        (ENTRY, ["trials", 0, "total"], 1e300, "total is 1e+300"),
        (ENTRY, ["trials", 1, "violations"], 0.5, "violations is 0.5"),
        (ENTRY, ["preparation", "seconds"], float("nan"), "seconds is nan"),
    ],
)
def test_a_damaged_value_is_named_with_its_file(tmp_path, name, keys, value, complaint):
    written_run(tmp_path, of(HVAC, 10, 5))
    values = json.loads((tmp_path / name).read_text())
    *outer, last = keys
    holder = values
    for key in outer:
        holder = holder[key]
    holder[last] = value
    (tmp_path / name).write_text(json.dumps(values))
    message = one_line(lambda: write_report(tmp_path))
    assert message.startswith(f"{tmp_path / name}: ")
    assert complaint in message


def test_conditions_without_what_a_report_shows_are_refused(tmp_path):
    keep_conditions(tmp_path, Rules(), {})
    assert one_line(lambda: write_report(tmp_path)) == f"{tmp_path / CONDITIONS}: cores is missing"


def test_a_folder_without_a_run_is_refused(tmp_path):
    missing = f"{tmp_path}: holds no run of mdpo-ipc (run.json is missing)"
    assert one_line(lambda: write_report(tmp_path)) == missing
    keep_conditions(tmp_path, Rules(), {"cores": 2})
    message = one_line(lambda: write_report(tmp_path))
    assert message == f"{tmp_path}: no entry has been played to its end yet"


def test_the_published_scores_are_complete_and_normalised():
    for planner, domains in SCORES.items():
        assert len(domains) == 8
        values = np.array(list(domains.values()))
        assert values.shape == (8, 5)
        assert np.all((values >= 0) & (values <= 1)), planner
    assert published_score("JaxDRP", "Reservoir_ippc2023", "4") == 1
    assert published_score("JaxDRP", "Reservoir_ippc2023", "6") is None
    assert published_score("JaxDRP", "Wildfire_MDP_ippc2014", "1") is None
