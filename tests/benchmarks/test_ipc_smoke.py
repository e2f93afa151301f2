"""The IPC 2023 sweep: one process a run, its table, its command."""

from helpers import workers
from helpers.toy_experiments import add_row

from benchmarks import main as bench
from benchmarks.common.records import Records
from benchmarks.problems import attempts, names
from benchmarks.problems.attempts import COLUMNS, KEYS
from benchmarks.problems.ipc_smoke import ipc_smoke_table, run_ipc_smoke
from mdpo_rddl.machine.guarded import Limits

PLENTY = Limits(seconds=120, memory_gb=8)


def test_every_ipc_run_has_a_process_of_its_own(tmp_path, monkeypatch):
    tried, batches = [], {}

    def pretend(work, attempts, limits):
        (each,) = attempts
        tried.append((each.problem, each.instance, each.planner, each.iterations, each.episodes))
        batches[each.problem, each.instance] = each.test_batch
        return [(each, workers.ROW)]

    monkeypatch.setattr(attempts, "run_guarded", pretend)
    run_ipc_smoke(tmp_path, names.DOMAINS, names.INSTANCES, 50, 2, PLENTY)
    assert len(set(tried)) == len(tried) == 8 * 5 * 2
    assert tried[0] == ("HVAC_ippc2023", "1", "mdpo-drp", 50, 2)
    assert tried[-1] == ("UAV_ippc2023", "5", "mdpo-slp", 50, 2)
    smaller = {key: batch for key, batch in batches.items() if batch is not None}
    assert smaller == {("RecSim_ippc2023", "5"): 2}


def test_the_ipc_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "runs.csv", COLUMNS, KEYS)
    played = {"return": -1234.567, "illegal_actions": 3, "fallback_actions": 2}
    add_row(records, "UAV_ippc2023", "1", "mdpo-slp", **played)
    add_row(records, "UAV_ippc2023", "1", "mdpo-drp", status="memory", cause="over 8 GB")
    assert ipc_smoke_table(records) == (
        "1 of 2 runs without an error.\n"
        "\n"
        "| problem | instance | planner | status | return | illegal | fallback | s | MB |\n"
        "|---|---|---|---|---|---|---|---|---|\n"
        "| UAV_ippc2023 | 1 | mdpo-drp | memory: over 8 GB |  |  |  | 2 | 600 |\n"
        "| UAV_ippc2023 | 1 | mdpo-slp | ok | -1,234.57 | 3 | 2 | 2 | 600 |\n"
    )


def test_the_ipc_command_writes_its_table(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        attempts, "run_guarded", lambda work, attempts, _: [(attempts[0], workers.ROW)]
    )
    options = ["--domains", "UAV", "--instances", "1", "--out", str(tmp_path)]
    assert bench.main(["ipc-smoke", *options]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("2 of 2 runs without an error.\n")
    assert (tmp_path / "table.md").read_text(encoding="utf-8") == printed
