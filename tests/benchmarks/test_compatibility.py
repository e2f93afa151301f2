"""The sweeps over problems: what an attempt finds, how a bad end is recorded, the tables."""

import importlib.metadata
import textwrap
from types import FunctionType

import pytest
from helpers import workers
from helpers.toy_experiments import add_row, nothing_to_do

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.problems import attempts, compatibility
from benchmarks.problems import names as problem_names
from benchmarks.problems.attempts import COLUMNS, KEYS, PLANNERS, Attempt, run_attempt, try_all
from benchmarks.problems.compatibility import compatibility_table, run_compatibility
from benchmarks.problems.missing import missing_package
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.planner import upstream

PLENTY = Limits(seconds=120, memory_gb=8)


# --- a small part of the sweep ---------------------------------------------------------------


@pytest.mark.long
def test_a_problem_with_limited_bools_trains_with_every_planner_through_the_command(
    tmp_path, capsys
):
    # four bools, of which max-nondef-actions allows one
    name = "SysAdmin_MDP_ippc2011"
    options = ["--problems", name, "--instance", "1", "--max-horizon", "5", "--iterations", "2"]
    assert bench.main(["compatibility", *options, "--out", str(tmp_path)]) == 0
    table = capsys.readouterr().out
    assert (tmp_path / "table.md").read_text(encoding="utf-8") == table
    assert f"| {name} | 1 | 5 | ok | ok | ok | ok |\n" in table
    rows = Records(tmp_path / "rows.csv", COLUMNS, KEYS).rows
    assert [row["planner"] for row in rows] == list(PLANNERS)
    assert [row["illegal_actions"] for row in rows] == ["", "", "0", "0"]
    assert all(100 < float(row["peak_mb"]) < 4000 for row in rows)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "plan"),
    [
        ("RecSim_ippc2023", "drp"),
        ("MarsRover_ippc2023", "slp"),
        pytest.param("RecSim_ippc2023", "slp", marks=pytest.mark.slow),
        pytest.param("MarsRover_ippc2023", "drp", marks=pytest.mark.slow),
    ],
)
def test_ours_trains_and_plays_legally(name, plan):
    row = run_attempt(Attempt(name, "1", f"mdpo-{plan}", 2, 1, max_horizon=5, test_batch=1))
    assert (row["status"], row["cause"], row["horizon"]) == ("ok", "", 5)
    assert row["illegal_actions"] == 0


def test_what_trains_but_cannot_be_played_is_told_apart(tmp_path, monkeypatch):
    def evaluate(*arguments: object) -> None:
        raise RuntimeError("no such state")

    monkeypatch.setattr(attempts, "evaluate", evaluate)
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    _write_problem(domain, instance, cpf="s")
    row = run_attempt(Attempt(str(domain), str(instance), "mdpo-slp", 1, 1))
    assert (row["status"], row["cause"]) == ("not played", "no such state")


def test_a_failing_attempt_names_the_cause_without_this_machine_s_folders(tmp_path):
    (tmp_path / "d.rddl").write_text("domain nothing { types { a : object; }; }")
    files = str(tmp_path / "d.rddl"), str(tmp_path / "none.rddl")
    row = run_attempt(Attempt(*files, "mdpo-drp", 1, 1))
    assert row["status"] == "error"
    assert row["cause"] == "none.rddl: cannot read the instance file: No such file or directory"
    assert "return" not in row


@pytest.mark.parametrize(
    ("planner", "status", "cause"),
    [
        ("jaxplan-slp", "non-finite", "training return inf"),
        ("mdpo-slp", "error", "training diverged: no finite return in 1 iterations"),
    ],
)
def test_a_return_that_is_not_a_number_is_not_ok(tmp_path, planner, status, cause):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    # a number in 64 bit, too large for 32
    _write_problem(domain, instance, cpf="s", reward="exp[700.0 + push]")
    row = run_attempt(Attempt(str(domain), str(instance), planner, 1, 1))
    assert row["status"] == status
    assert row["cause"].startswith(cause)


def _write_problem(domain, instance, cpf: str, reward: str = "s") -> None:
    domain.write_text(
        textwrap.dedent(f"""
            domain toy {{
                pvariables {{
                    s : {{ state-fluent, real, default = 0.5 }};
                    push : {{ action-fluent, real, default = 0.0 }};
                }};
                cpfs {{ s' = {cpf}; }};
                reward = {reward};
            }}
        """)
    )
    instance.write_text(
        "non-fluents nf { domain = toy; }\n"
        "instance one { domain = toy; non-fluents = nf; max-nondef-actions = pos-inf; "
        "horizon = 2; discount = 1.0; }\n"
    )


# --- what the environment lacks --------------------------------------------------------------


def _fail() -> None:
    raise AttributeError("module 'jax.interpreters.xla' has no attribute 'gone'")


class _Broken:
    """As tensorflow-probability beside a jax that it does not know: it fails on first use."""

    distributions = property(
        lambda self: FunctionType(
            _fail.__code__,
            {"__name__": "tensorflow_probability.inside", "AttributeError": AttributeError},
        )()
    )


@pytest.mark.parametrize(
    ("module", "versions", "complaint"),
    [
        (None, {}, "which is not installed"),
        (
            _Broken(),
            {"tensorflow-probability": "0.25.0", "jax": "0.10.2"},
            "but the installed 0.25.0 does not work with jax 0.10.2",
        ),
    ],
)
def test_a_distribution_that_needs_another_package_says_which(
    tmp_path, monkeypatch, module, versions, complaint
):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    _write_problem(domain, instance, cpf="s + NegativeBinomial(3, 0.5)")

    def version(package: str) -> str:
        if package not in versions:
            raise importlib.metadata.PackageNotFoundError(package)
        return versions[package]

    monkeypatch.setattr(upstream.compiler, "tfp", module)
    monkeypatch.setattr(importlib.metadata, "version", version)
    ours, jaxplan = (
        run_attempt(Attempt(str(domain), str(instance), planner, 1, 1))
        for planner in ("mdpo-slp", "jaxplan-slp")
    )
    assert ours["status"] == "ok"
    message = jaxplan["cause"]
    assert message.isprintable()
    assert f"NegativeBinomial need tensorflow-probability, {complaint}" in message
    assert message.endswith("pip install tensorflow-probability 'jax<0.7' 'flax<0.12'")


def test_other_failures_are_not_put_down_to_a_missing_package():
    with pytest.raises(AttributeError) as error:
        _fail()
    assert missing_package(error.value) is None


# --- processes that end badly ----------------------------------------------------------------


FATES = ["good", "crash", "exit", "hang", "hungry", "better"]
# a process that starts beside others needs some seconds before it has taken all memory
FATAL = Limits(seconds=8, memory_gb=1.2)


@pytest.fixture(scope="module")
def fates(tmp_path_factory) -> Records:
    """A sweep whose workers crash, exit, hang and take all memory."""
    records = Records(tmp_path_factory.mktemp("fates") / "rows.csv", COLUMNS, KEYS)
    all_fates = [Attempt("p", "1", fate, 1, 1) for fate in FATES]
    try_all(records, all_fates, FATAL, workers.fate)
    return records


@pytest.mark.long
def test_the_sweep_goes_on_after_every_kind_of_death(fates):
    assert [row["planner"] for row in fates.rows] == FATES
    assert [row["status"] for row in fates.rows] == [
        "ok", "crash", "crash", "timeout", "memory", "ok"
    ]  # fmt: skip
    assert [row["cause"] for row in fates.rows] == [
        "",
        "killed by SIGABRT: no such kernel",
        "exit status 3",
        "over 8 s",
        "over 1.2 GB",
        "",
    ]
    processes = {row["return"] for row in fates.rows if row["return"]}
    assert len(processes) == 2  # a fresh one after each death
    _, _, _, hanging, hungry, _ = fates.rows
    assert 3 <= float(hanging["seconds"]) < 60
    assert 1.2e9 // 2**20 <= float(hungry["peak_mb"]) < 2300


@pytest.mark.long
def test_what_is_recorded_is_not_tried_again(fates, monkeypatch):
    again = Records(fates.path, COLUMNS, KEYS)
    monkeypatch.setattr(attempts, "run_guarded", nothing_to_do)
    try_all(again, [Attempt("p", "1", fate, 1, 1) for fate in FATES], FATAL, workers.fate)
    assert again.rows == fates.rows


def test_only_what_is_missing_is_tried(tmp_path, monkeypatch):
    tried: list[list[str]] = []

    def pretend(work, attempts, limits):
        tried.append([f"{each.problem} {each.planner}" for each in attempts])
        return [(each, workers.ROW) for each in attempts]

    monkeypatch.setattr(attempts, "run_guarded", pretend)
    names = ["Elevators", "SysAdmin_MDP_ippc2011"]
    records = run_compatibility(tmp_path, names, None, 3, 20, PLENTY)
    assert tried == [[f"{name} {planner}" for planner in PLANNERS] for name in names]
    assert [row["instance"] for row in records.rows] == ["0"] * 4 + ["1"] * 4  # each one's first

    lines = records.path.read_text().splitlines(keepends=True)
    records.path.write_text("".join(lines[:3] + lines[5:]))
    tried.clear()
    again = run_compatibility(tmp_path, names, None, 3, 20, PLENTY)
    assert tried == [["Elevators mdpo-drp", "Elevators mdpo-slp"]]
    assert len(again.rows) == 8
    with pytest.raises(InputError, match="made with another iterations"):
        run_compatibility(tmp_path, names, None, 4, 20, PLENTY)


def test_all_problems_of_the_repository_are_the_default(tmp_path, monkeypatch):
    problems: list[Attempt] = []
    monkeypatch.setattr(
        compatibility, "try_all", lambda _, attempts, limits: problems.extend(attempts)
    )
    run_compatibility(tmp_path, None, None, 3, 20, PLENTY)
    names = {each.problem for each in problems}
    assert len(problems) == 4 * len(names)
    assert {f"{domain}_ippc2023" for domain in problem_names.DOMAINS} < names


# --- tables ----------------------------------------------------------------------------------


def test_the_compatibility_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "rows.csv", COLUMNS, KEYS)
    for planner in PLANNERS:
        add_row(records, "B", "1", planner)
    add_row(records, "A", "0", "jaxplan-drp", status="error", cause="no | such <thing>")
    add_row(records, "A", "0", "jaxplan-slp")
    add_row(records, "A", "0", "mdpo-drp", status="error", cause="no | such <thing>")
    add_row(records, "A", "0", "mdpo-slp", status="timeout", cause="over 9 s", horizon="")
    add_row(records, "C", "2", "jaxplan-drp", status="crash", cause="exit status 3", horizon="")
    add_row(records, "D", "1", "jaxplan-drp")
    add_row(records, "D", "1", "mdpo-drp", status="not played", cause="no such state")
    header = f"| problem | instance | horizon | {' | '.join(PLANNERS)} |\n"
    assert compatibility_table(records) == (
        f"{header}|---|---|---|---|---|---|---|\n"
        "| A | 0 | 20 | error (1) | ok | error (1) | timeout (4) |\n"
        "| B | 1 | 20 | ok | ok | ok | ok |\n"
        "| C | 2 |  | crash (2) |  |  |  |\n"
        "| D | 1 | 20 | ok |  | not played (3) |  |\n"
        "| **ok** | | | 2 of 4 | 2 of 2 | 1 of 3 | 1 of 2 |\n"
        "\n"
        "JaxPlan trains and ours does not: A 0 (slp).\n"
        "\n"
        "Causes:\n"
        "\n"
        "1. error: no \\| such \\<thing>\n"
        "2. crash: exit status 3\n"
        "3. not played: no such state\n"
        "4. timeout: over 9 s\n"
    )


def test_the_compatibility_table_of_a_sweep_without_failures(tmp_path):
    records = Records(tmp_path / "rows.csv", COLUMNS, KEYS)
    for planner in PLANNERS:
        add_row(records, "B", "1", planner)
    table = compatibility_table(records)
    assert table.endswith("| 1 of 1 |\n\nJaxPlan trains and ours does not: none.\n")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("/usr/lib/site/a/domain.rddl: bad\n  thing", "domain.rddl: bad thing"),
        ("JaxPlan: a/b/c and 1/2 stay", "JaxPlan: a/b/c and 1/2 stay"),
        ("", "ValueError"),
        ("x" * 400, "x" * 239 + "…"),
    ],
)
def test_a_cause_is_one_short_line(text, line):
    assert one_line_cause(ValueError(text)) == line


# --- the commands ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("compatibility --problems Elevator", "rddlrepository has no problem 'Elevator'"),
        ("compatibility --timeout 0", "--timeout: must be a number above 0, got '0'"),
        ("compatibility --memory-gb -1", "--memory-gb: must be a number above 0, got '-1'"),
        ("ipc-smoke --domains Mars", "invalid choice: 'Mars'"),
        ("ipc-smoke --iterations 0", "--iterations: must be a positive integer, got '0'"),
    ],
)
def test_bad_options_are_refused_in_one_line(tmp_path, capsys, arguments, complaint):
    try:
        status = bench.main([*arguments.split(), "--out", str(tmp_path)])
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert complaint in line
