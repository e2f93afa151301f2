"""The Slurm executor on a real Slurm of one node, which is started here and stopped again."""

import os
import shutil
import subprocess
import threading
import time
from dataclasses import replace

import pytest
from helpers.mistakes import one_line
from helpers.problems import ROOT
from helpers.slurm_work import write_name
from helpers.toy_contest import RULES, Pausing, entry, tiny_instance

from benchmarks import main as bench
from mdpo_rddl.cli import ipc
from mdpo_rddl.ipc.contestant import PREPARE, Contestant
from mdpo_rddl.ipc.results import load_results
from mdpo_rddl.machine.executors import SlurmExecutor

pytestmark = pytest.mark.slurm
SCRIPT = str(ROOT / "tools" / "slurm.sh")


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """A running Slurm, which all commands find by their environment."""
    if shutil.which("sbatch") is None or os.getuid() != 0:
        pytest.skip("Slurm is not installed here, or only root could start it")
    pytest.importorskip("submitit")
    folder = str(tmp_path_factory.mktemp("slurm"))
    begun = subprocess.run([SCRIPT, "start", folder], capture_output=True, text=True, check=False)
    assert begun.returncode == 0, begun.stderr
    paths = [str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SLURM_CONF", begun.stdout.split("=", 1)[1].strip())
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
        yield
    subprocess.run([SCRIPT, "stop", folder], check=True)


def quick(folder, **values):
    options = {"cpus": 1, "memory_gb": 2.0, "minutes": 5, "look_seconds": 0.5}
    return SlurmExecutor(folder / "jobs", **{**options, **values})


def queue(form):
    command = ["squeue", "--array", "--noheader", f"--format={form}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()


def preempt(has_begun):
    """Preempts the one job once it has begun, as Slurm does, and does not let it wait long."""
    while not has_begun():
        time.sleep(0.1)
    (job,) = queue("%i")
    for number in ("TERM", "USR2"):
        subprocess.run(["scancel", f"--signal={number}", job], check=True)
    while queue("%T %r") != ["PENDING", "BeginTime"]:
        time.sleep(0.2)
    subprocess.run(["scontrol", "update", f"JobId={job}", "StartTime=now"], check=True)


@pytest.mark.long
def test_a_killed_job_is_submitted_again_and_a_failed_one_is_named(slurm, tmp_path):
    tasks = [(tmp_path, name) for name in ("done", "killed", "raising")]
    message = one_line(lambda: quick(tmp_path).run(write_name, tasks))
    cause = "1 of 3 tasks failed, see the logs there; first: ValueError: no such number"
    assert message == f"{tmp_path / 'jobs'}: {cause}"
    for name in ("done", "killed"):
        assert (tmp_path / name).read_text() == "1"


@pytest.mark.slow
def test_a_task_whose_jobs_are_lost_is_given_up_in_the_end(slurm, tmp_path):
    executor = quick(tmp_path, submissions=1)
    message = one_line(lambda: executor.run(write_name, [(tmp_path, "killed")]))
    assert message.endswith(
        "1 of 1 tasks failed, see the logs there; first: its jobs ended without a word"
    )


def test_a_folder_with_jobs_in_the_queue_is_refused(slurm, tmp_path):
    executor = quick(tmp_path)
    command = ["sbatch", "--hold", f"--job-name={executor._name}", "--wrap=true"]
    subprocess.run([*command, "--output=/dev/null"], check=True, capture_output=True)
    message = one_line(lambda: executor.run(write_name, [(tmp_path, "done")]))
    end = f"scancel --name={executor._name}"
    assert message.startswith(f"{tmp_path / 'jobs'}: 1 jobs of an earlier run have not ended")
    assert message.endswith(end)
    subprocess.run(end.split(), check=True)


def test_jobs_that_slurm_refuses_are_an_input_error(slurm, tmp_path):
    executor = quick(tmp_path, partition="nowhere")
    message = one_line(lambda: executor.run(write_name, [(tmp_path, "done")]))
    assert message.startswith("Slurm does not take the jobs: ")
    assert "nowhere" in message


@pytest.mark.long
def test_a_preempted_run_has_the_results_of_one_that_was_not(slurm, tmp_path):
    problem = tiny_instance(tmp_path / "tiny")
    each, rules = entry(problem, Pausing), replace(RULES, trials=4, memory_gb=2.0)
    here = Contestant(each, rules, tmp_path / "here")
    here(PREPARE)
    totals = [here(trial)["total"] for trial in range(4)]

    out = tmp_path / "out"
    options = ["--problems", f"{problem.domain}:{problem.instance}", "--trials", "4"]
    options += ["--plan-seconds", "60", "--trial-seconds", "60", "--memory-gb", "2"]
    options += ["--executor", "slurm", "--slurm-cpus", "1", "--slurm-memory-gb", "3"]
    begun = each.folder(out / "traces") / "trial-01.npz"
    preempting = threading.Thread(target=preempt, args=(begun.exists,), daemon=True)
    preempting.start()
    assert ipc.main(["run", "--planners", each.planner, *options, "--out", str(out)]) == 0
    preempting.join(1.0)
    assert not preempting.is_alive()
    (there,) = load_results(out)
    assert [trial.status for trial in there.trials] == ["ok"] * 4
    assert [trial.total for trial in there.trials] == totals
    logs = "".join(path.read_text() for path in (out / "jobs").glob("*.err"))
    assert "this job is preempted" in logs


@pytest.mark.long
def test_a_sweep_of_the_paper_is_the_same_on_slurm(slurm, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)  # where the settings are
    size = ["--settings", "powergen7", "--methods", "deterministic", "constant-1"]
    size += ["--seeds", "2", "--iterations", "3", "--rollouts", "2", "--episodes", "1"]
    slurm_options = ["--executor", "slurm", "--slurm-cpus", "1", "--slurm-memory-gb", "3"]
    for out, options in (("there", slurm_options), ("here", [])):
        folder = tmp_path / out
        monkeypatch.setattr("benchmarks.commands.paper.run_landscape", lambda out: None)
        assert bench.main(["paper", *size, *options, "--out", str(folder)]) == 0
    tables = [(tmp_path / out / "runs.csv").read_text() for out in ("there", "here")]
    assert tables[0] == tables[1]
    assert len(tables[0].splitlines()) == 1 + 2 * 2
