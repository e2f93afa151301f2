"""The wheel in an empty environment: its commands, its data and the README's Python.

`make test-wheel` runs it, with each Python that WHEEL_PYTHONS names.
"""

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from helpers.problems import ROOT

PYTHONS = os.environ.get("WHEEL_PYTHONS", sys.executable).split()
QUICK = "--preset paper --iterations 2 --horizon 5 --episodes 2 --out run --quiet --json"
COMMANDS = {
    "mdpo-plan --list": "Reservoir_ippc2023 1|2|3|4|5\n",
    f"mdpo-plan hvac10 {QUICK}": '"label": "hvac10"',
    "mdpo-report run": "written to run/report.html",
    "mdpo-ipc run --problems HVAC_ippc2023:1 --planners noop,random --trials 1 --out ipc": "noop",
}

pytestmark = [pytest.mark.wheel, pytest.mark.timeout(1200)]


def run(command: list[str], folder: Path) -> str:
    """Runs a command that knows nothing of the checkout; returns what it prints."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the source distribution as `python -m build` does."""
    folder = tmp_path_factory.mktemp("dist")
    run([sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)], folder)
    run([sys.executable, "-m", "twine", "check", "--strict", *map(str, folder.iterdir())], folder)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="session", params=PYTHONS, ids=lambda path: Path(path).parts[-3])
def installed(request: pytest.FixtureRequest, wheel: Path, tmp_path_factory) -> Path:
    """The folder of the commands of an environment that holds the wheel and what it needs."""
    folder = tmp_path_factory.mktemp("environment")
    run([request.param, "-m", "venv", str(folder)], folder)
    pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet"]
    run([*pip, "--constraint", str(ROOT / "constraints.txt"), str(wheel)], folder)
    return folder / "bin"


def test_the_wheel_has_the_problems_the_tables_and_the_types(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert not any(name.startswith("benchmarks/") for name in names)
    inside = {name.split("/", 1)[1] for name in names}
    for folder in ("domains", "instances"):
        names = {path.name for path in (ROOT / folder).iterdir()}
        assert names
        assert {f"shipped/{folder}/{name}" for name in names} <= inside
    assert "py.typed" in inside
    assert {
        "session/report/page/run.html.j2",
        "planner/config/shipped/HVAC_ippc2023_drp.cfg",
    } <= inside


def test_the_commands_run_in_any_folder(installed, tmp_path):
    for command, said in COMMANDS.items():
        name, *arguments = command.split()
        assert said in run([str(installed / name), *arguments], tmp_path)
    (source,) = re.findall(r"^version = \"(.*)\"$", (ROOT / "pyproject.toml").read_text(), re.M)
    assert run([str(installed / "mdpo-plan"), "--version"], tmp_path) == f"mdpo-plan {source}\n"


def test_the_python_of_the_readme_runs(installed, tmp_path):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", readme, flags=re.DOTALL)[1]
    run([str(installed / "python"), "-W", "ignore", "-c", code], tmp_path)


def test_only_the_pythons_that_are_tested_are_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
    (tested,) = re.findall(r"^PYTHONS \?= (.*)$", (ROOT / "Makefile").read_text(), re.M)
    assert tested.split() == declared
