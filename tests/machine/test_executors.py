"""Where work is done: the executors by their names, and how work here is done."""

import sys

import pytest
from helpers.mistakes import one_line

from mdpo_rddl.cli import ipc
from mdpo_rddl.machine.executors import LocalExecutor, SlurmExecutor, make_executor


def test_local_work_is_done_in_its_order():
    done: list[int] = []
    make_executor("local", {}).run(done.append, [3, 1, 2])
    assert done == [3, 1, 2]


def test_executors_are_known_by_their_names(tmp_path):
    assert isinstance(make_executor("local", {}), LocalExecutor)
    made = make_executor("slurm", {"folder": tmp_path, "cpus": 3})
    assert made == SlurmExecutor(tmp_path, cpus=3)
    # the documented resources
    assert (SlurmExecutor.cpus, SlurmExecutor.memory_gb) == (2, 8.0)
    message = one_line(lambda: make_executor("pbs", {}))
    assert message == "unknown executor 'pbs', known are local, slurm"


def test_without_submitit_the_complaint_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "submitit", None)
    message = one_line(lambda: SlurmExecutor(tmp_path).run(print, [1]))
    assert message == "Slurm needs submitit: pip install 'mdpo-rddl[slurm]'"


def test_without_slurm_the_complaint_says_so(tmp_path, monkeypatch):
    pytest.importorskip("submitit")
    monkeypatch.setenv("PATH", str(tmp_path))
    message = one_line(lambda: SlurmExecutor(tmp_path).run(print, [1]))
    assert message.startswith("there is no Slurm here: ")


def test_options_of_slurm_need_slurm(tmp_path, capsys):
    arguments = ["run", "--planners", "noop", "--out", str(tmp_path / "out"), "--slurm-cpus", "4"]
    assert ipc.main(arguments) == 2
    assert capsys.readouterr().err == "mdpo-ipc: error: --slurm-cpus needs --executor slurm\n"


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--memory-gb", "8"], "jobs of 8 GB cannot hold planners of 8 GB: set --slurm-memory-gb"),
        (
            ["--memory-gb", "4", "--slurm-minutes", "61"],
            "jobs of 61 minutes cannot hold a preparation of 3600 s: set --slurm-minutes",
        ),
    ],
)
def test_jobs_must_hold_what_the_rules_give(tmp_path, capsys, options, complaint):
    out = tmp_path / "out"
    arguments = ["run", "--planners", "noop", "--out", str(out), "--executor", "slurm"]
    assert ipc.main([*arguments, *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"mdpo-ipc: error: {complaint}")
    assert not out.exists()
