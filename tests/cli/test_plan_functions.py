"""`mdpo-plan --functions`: a domain that calls Python functions, planned, kept and played again."""

from pathlib import Path

import pytest
from helpers.files import changed
from helpers.plan_command import DOMAIN, INSTANCE, refuse, run

CALLING = changed(DOMAIN, "volume(?t) + fill(?t)", "$filled[](volume(?t), fill(?t))")
CODE = "def filled(volume, fill):\n    return volume + 0.5 * fill\n"
OPTIONS = "--preset paper --iterations 5 --episodes 2 --out run --json"


@pytest.fixture
def calling(workplace: Path) -> Path:
    """The current folder, with a problem that calls a function, and its file."""
    (workplace / "tanks.rddl").write_text(CALLING + INSTANCE)
    (workplace / "tanks.py").write_text(CODE)
    return workplace


def test_a_run_and_what_is_made_of_its_folder(
    calling: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mdpo_rddl.cli import report as report_command

    planned = run(f"tanks.rddl --functions tanks.py {OPTIONS}", capsys).summary
    loaded = run("--load run --functions tanks.py --episodes 2 --json", capsys).summary
    assert loaded["returns"] == planned["returns"]
    (calling / "run" / "report.html").unlink()
    assert report_command.main(["run"]) == 0
    assert (calling / "run" / "report.html").is_file()
    said = (
        "tanks.rddl: calls Python functions of tanks.py, which are not kept: give them again, "
        "with --functions FILE.py or functions="
    )
    refuse("--load run", said, calling, capsys)
    (calling / "tanks.py").write_text(CODE.replace("0.5", "0.6"))
    said = "run/policy.safetensors: saved for"
    refuse("--load run --functions tanks.py", said, calling, capsys, start=True)


def test_one_that_cannot_be_compiled_is_refused(
    calling: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = "def filled(volume, fill):\n    return volume + fill if fill > 0 else volume\n"
    (calling / "tanks.py").write_text(code)
    said = "tanks.py: the function filled cannot be compiled (TracerBoolConversionError)"
    refuse(f"tanks.rddl --functions tanks.py {OPTIONS} --quiet", said, calling, capsys, start=True)


def test_no_file(calling: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = "none.py: cannot read the file of functions: No such file or directory"
    refuse(f"tanks.rddl --functions none.py {OPTIONS}", said, calling, capsys)
    said = (
        "tanks.rddl: calls the Python function $filled: give the file that has it, with "
        "--functions FILE.py or functions="
    )
    refuse(f"tanks.rddl {OPTIONS}", said, calling, capsys)
