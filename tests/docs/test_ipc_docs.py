"""docs/ipc.md keeps its word, and so does the Dockerfile."""

import re
import tomllib

from helpers.problems import ROOT
from helpers.toy_contest import tiny_instance
from helpers.workers import in_this_process

from mdpo_rddl.cli import ipc
from mdpo_rddl.ipc import run as running
from mdpo_rddl.ipc.names import PLANNER_NAMES
from mdpo_rddl.ipc.results import load_results
from mdpo_rddl.machine.executors import SlurmExecutor

PAGE = (ROOT / "docs" / "ipc.md").read_text(encoding="utf-8")
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_the_example_planner_takes_part_and_beats_noop(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "best_constant.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(running, "run_guarded", in_this_process)
    problem = tiny_instance(tmp_path / "tiny", spread=0.0)
    options = ["--problems", f"{problem.domain}:{problem.instance}", "--trials", "2"]
    options += ["--planners", "best_constant:BestConstant,noop,random", "--plan-seconds", "3"]
    assert ipc.main(["run", *options, "--out", str(tmp_path / "out")]) == 0
    assert "| best_constant:BestConstant | 1.000 | 1 | 1 of 1 |" in capsys.readouterr().out
    assert {result.entry.planner for result in load_results(tmp_path / "out")} == {
        "best_constant:BestConstant",
        "noop",
        "random",
    }


def test_every_planner_and_every_option_is_described():
    table = PAGE[: PAGE.index("## A run")]
    for name in PLANNER_NAMES:
        assert f"`{name}`" in table
    described = set(re.findall(r"--[a-z][a-z-]*", PAGE))
    known = set()
    parser = ipc._parser()
    (commands,) = (action for action in parser._actions if action.choices)
    for command in commands.choices.values():
        known |= {name for action in command._actions for name in action.option_strings}
    docker = {"--tag", "--rm", "--volume"}
    assert described <= known | docker
    assert known - described == {"-h", "--help"}
    for name in ("cpus", "memory_gb", "minutes", "parallel"):
        option = "--slurm-" + name.replace("_", "-")
        (row,) = (line for line in PAGE.splitlines() if line.startswith(f"| `{option}`"))
        assert row.endswith(f"| {getattr(SlurmExecutor, name):g} |")


def test_the_dockerfile_packs_what_is_there_and_runs_the_agent():
    copied = re.findall(r"^COPY (?!--from)(.*) \S+$", DOCKERFILE, flags=re.MULTILINE)
    ignored = (ROOT / ".dockerignore").read_text().split()
    for name in " ".join(copied).split():
        assert (ROOT / name).exists()
        assert f"!{name}" in ignored
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    (entry,) = re.findall(r'^ENTRYPOINT \["(.*?)"', DOCKERFILE, flags=re.MULTILINE)
    assert entry.rsplit("/", 1)[1] in scripts
    bases = re.findall(r"^FROM (\S+)", DOCKERFILE, flags=re.MULTILINE)
    assert all("slim" in base for base in bases)
