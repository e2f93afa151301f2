"""`mdpo-ipc`: its commands from end to end on the toy problem, and bad input."""

import io
import os

import pytest
from helpers.mistakes import one_line
from helpers.toy_contest import RULES, entry, tiny_instance
from helpers.workers import in_this_process
from rich.console import Console

from mdpo_rddl.cli import ipc, ipc_commands
from mdpo_rddl.cli.ipc_display import LiveTable
from mdpo_rddl.ipc import run as running
from mdpo_rddl.ipc.problems import COMPETITION, parse_problems
from mdpo_rddl.ipc.results import EntryResult, Preparation, Trial, load_results
from mdpo_rddl.ipc.rules import Instance

LIMITS = ["--plan-seconds", "60", "--trial-seconds", "30", "--memory-gb", "8"]
EXACT = "helpers.toy_contest:Exact"


@pytest.fixture
def problem(tmp_path):
    return tiny_instance(tmp_path / "tiny")


def text_of(problem):
    return f"{problem.domain}:{problem.instance}"


@pytest.mark.long
def test_run_plays_and_scores_and_goes_on(problem, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    planners = f"{EXACT},noop"
    options = ["--problems", text_of(problem), "--trials", "2", "--out", str(out), *LIMITS]
    assert ipc.main(["run", "--planners", planners, *options]) == 0
    printed = capsys.readouterr().out
    assert f"| {EXACT} | 1.000 | 1 | 1 of 1 | 0 | 0 | 0 |" in printed
    assert (out / "scores.md").read_text() == printed
    before = load_results(out)
    assert [len(result.trials) for result in before] == [2, 2]

    monkeypatch.setattr(running, "run_guarded", None)  # nothing is left to do
    assert ipc.main(["run", "--planners", planners, *options]) == 0
    assert load_results(out) == before
    capsys.readouterr()
    assert ipc.main(["score", str(out)]) == 0
    assert capsys.readouterr().out == printed

    assert ipc.main(["run", "--planners", planners, *options, "--seed", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"mdpo-ipc: error: {out}/run.json: the run was begun with another seed")


def test_agent_plays_one_instance(problem, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(running, "run_guarded", in_this_process)
    arguments = ["agent", problem.domain, problem.instance]
    options = [*LIMITS, "--out", str(tmp_path / "out")]
    assert ipc.main([*arguments, EXACT, "3", *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" with return ")[0] for line in lines] == [
        f"episode {number} ended" for number in (1, 2, 3)
    ]
    options[-1] += "2"
    assert ipc.main([*arguments, "helpers.toy_contest:Raising", "2", *options]) == 1
    _, second = capsys.readouterr().out.splitlines()
    assert (
        second == "episode 2 ended with return 0.0 (error: step 0: RuntimeError: no plan for this)"
    )


def test_agent_knows_the_domains_by_the_competitions_names(tmp_path, capsys, monkeypatch):
    asked = []
    monkeypatch.setattr(ipc_commands, "run", lambda out, entries, *_: asked.extend(entries))
    ipc.main(["agent", "HVAC", "2", "noop", "1", "--out", str(tmp_path / "out")])
    assert [each.problem for each in asked] == [Instance("HVAC_ippc2023", "2")]


def test_an_interrupt_ends_with_one_line(problem, tmp_path, capsys, monkeypatch):
    def interrupt(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(ipc_commands, "run", interrupt)
    options = ["--problems", text_of(problem), "--out", str(tmp_path / "out")]
    assert ipc.main(["run", "--planners", "noop", *options]) == 130
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "mdpo-ipc: interrupted; the same command goes on from here"


# --- problems --------------------------------------------------------------------------------


def test_problems_are_names_with_ranges_or_files(problem):
    text = f"HVAC_ippc2023:1-3,5, RaceCar_ippc2023:2,{text_of(problem)}"
    assert parse_problems(text) == [
        *(Instance("HVAC_ippc2023", name) for name in ("1", "2", "3", "5")),
        Instance("RaceCar_ippc2023", "2"),
        problem,
    ]
    assert (problem.domain_label, problem.label) == ("d", "i")


def test_the_competition_has_forty_instances():
    problems = parse_problems(COMPETITION)
    assert len(problems) == 40
    assert len({each.domain for each in problems}) == 8


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "there is no problem in it"),
        ("HVAC_ippc2023", "'HVAC_ippc2023' names no domain, write DOMAIN:INSTANCE"),
        ("HVCA:1", "rddlrepository has no problem 'HVCA'"),
        ("MarsRover_ippc2023:9", "MarsRover_ippc2023 has no instance '9', known are 0 1 2 3 4 5"),
        ("HVAC_ippc2023:3-1", "the range 3-1 is empty"),
        ("HVAC_ippc2023:1,1", "HVAC_ippc2023:1 is there twice"),
        ("no.rddl:i.rddl", "no.rddl: no such file"),
    ],
)
def test_bad_problems_are_named(text, complaint):
    assert one_line(lambda: parse_problems(text)) == f"--problems: {complaint}"


# --- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("planners", "complaint"),
    [
        ("mdpo,nop", "unknown planner 'nop', known are mdpo, mdpo-thinking"),
        ("no_such_module:Planner", "planner 'no_such_module:Planner' cannot be loaded: Module"),
        (
            "helpers.toy_contest:Nobody",
            "planner 'helpers.toy_contest:Nobody' cannot be loaded: Attribute",
        ),
        ("helpers.toy_contest:NoActs", "planner 'helpers.toy_contest:NoActs' has no method 'act'"),
        (",", "--planners: there is no planner in it"),
    ],
)
def test_bad_planners_are_named_and_nothing_is_written(
    problem, tmp_path, capsys, planners, complaint
):
    out = tmp_path / "out"
    options = ["--problems", text_of(problem), "--planners", planners, "--out", str(out)]
    assert ipc.main(["run", *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"mdpo-ipc: error: {complaint}")
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["run"], "--out"),
        (["run", "--out", "o", "--trials", "0"], "must be a positive integer, got '0'"),
        (["run", "--out", "o", "--plan-seconds", "nan"], "must be a number above 0, got 'nan'"),
        (["run", "--out", "o", "--executor", "pbs"], "invalid choice: 'pbs'"),
        (["agent", "HVAC", "1", "noop"], "episodes"),
        (["play"], "invalid choice: 'play'"),
    ],
)
def test_bad_options_are_refused_in_one_line(capsys, arguments, complaint):
    with pytest.raises(SystemExit) as ended:
        ipc.main(arguments)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert complaint in line


def test_a_folder_with_something_else_is_left_alone(problem, tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    options = ["--problems", text_of(problem), "--planners", "noop", "--out", str(tmp_path)]
    assert ipc.main(["run", *options]) == 2
    complaint = "is not empty and holds no run; use another --out"
    assert capsys.readouterr().err == f"mdpo-ipc: error: {tmp_path}: {complaint}\n"
    assert sorted(os.listdir(tmp_path)) == ["notes.txt", "tiny"]


# --- the live table --------------------------------------------------------------------------


def test_the_live_table_shows_what_is_done_and_what_leads(problem, tmp_path):
    planners = ["noop", "random", "mdpo", "jaxplan-slp", "jaxplan-drp"]
    entries = [entry(problem, name) for name in planners]
    entries += [
        entry(Instance("UAV_ippc2023", number), name) for number in "12" for name in planners
    ]
    ready = Preparation("ok", "", 1.0, 100.0)
    trials = [Trial(i, "ok", "", -float(i), 3, 0, 0.1) for i in range(3)]
    EntryResult(entries[0], 3, ready, tuple(trials)).save(tmp_path)
    EntryResult(entries[1], 3, ready, tuple(trials[2:])).save(tmp_path)
    EntryResult(entries[2], 3, ready).save(tmp_path)
    EntryResult(entries[3], 3, Preparation("timeout", "", 9.0, 9.0)).save(tmp_path)
    table = LiveTable(tmp_path, entries, RULES, shown=False).table()
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(table)
    text = console.export_text()
    assert "2 of 15 entries, 4 trials" in text
    (row,) = [line for line in text.splitlines() if "d i" in line]
    cells = [cell.strip() for cell in row.split("│")[1:-1]]
    assert cells == ["d i", "-1", "-2 1", "ready", "timeout", ""]
    assert "UAV_ippc2023 1" in text  # what comes next
    assert "UAV_ippc2023 2" not in text
    assert table.columns[1].footer == "1"
    assert table.columns[1]._cells == ["[bold green]-1[/bold green]", ""]


@pytest.mark.parametrize("instances", ["1-3", "1,2"])
def test_an_agent_plays_one_instance(instances, tmp_path, capsys):
    arguments = ["agent", "HVAC_ippc2023", instances, "noop", "1"]
    assert ipc.main([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert f"{instances}: an agent plays one instance" in capsys.readouterr().err
