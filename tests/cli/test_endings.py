"""How commands end that are interrupted early, or that the system refuses something."""

import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.plan_command import write_problem

from mdpo_rddl.cli import report
from mdpo_rddl.cli.ending import ending_in_order
from mdpo_rddl.cli.importing import ended_at_once
from mdpo_rddl.cli.logs import show_log
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine import cache
from mdpo_rddl.machine.files import read_bounded

LONG = "x" * 300


def started(name: str, arguments: str, folder: Path, **options: object) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", f"mdpo_rddl.cli.{name}", *arguments.split()],
        cwd=folder,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        **{"stdout": subprocess.DEVNULL, **options},
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("option", ["--load", "--start-from"])
def test_a_name_that_is_too_long_is_one_line(option: str, tmp_path: Path) -> None:
    write_problem(tmp_path)
    said = f"mdpo-plan: error: {LONG}: File name too long\n"
    assert started("plan", f"tanks.rddl two.rddl {option} {LONG}", tmp_path) == (2, said)


def test_a_full_disk_behind_the_output_is_one_line(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        ended = started("plan", "--list", tmp_path, stdout=full)
    assert ended == (2, "mdpo-plan: error: the output: No space left on device\n")


def test_a_pipe_that_nobody_reads_ends_the_command_silently(tmp_path: Path) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    ended = started("plan", "--list", tmp_path, stdout=theirs)
    os.close(theirs)
    assert ended == (128 + signal.SIGPIPE, "")


BEGIN = """
import os, signal, sys
from mdpo_rddl.cli import start
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "argparse" or name.startswith("mdpo_rddl.cli."):
            signal.raise_signal(signal.SIGINT)
sys.modules.pop("argparse", None)
sys.meta_path.insert(0, Interrupting())
sys.exit(start.{name}())
"""


@pytest.mark.parametrize("name", ["plan", "ipc", "report"])
def test_an_interrupt_during_the_imports_is_quiet(name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BEGIN.format(name=name)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_an_interrupt_of_the_report_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(report, "_write", lambda _: signal.raise_signal(signal.SIGINT))
    assert report.main([str(tmp_path)]) == 130
    assert capsys.readouterr() == ("", "mdpo-report: interrupted\n")


def test_what_may_not_be_read_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    @ending_in_order("mdpo-toy")
    def main(arguments: object = None) -> int:
        raise PermissionError(13, "Permission denied", "/a/summary.json")

    assert main(None) == 2
    assert capsys.readouterr().err == "mdpo-toy: error: /a/summary.json: Permission denied\n"


@pytest.mark.parametrize("error", [ZeroDivisionError(), OSError("no source"), TimeoutError("late")])
def test_an_error_of_ours_keeps_its_traceback(error: Exception) -> None:
    @ending_in_order("mdpo-toy")
    def main(arguments: object = None) -> int:
        raise error

    with pytest.raises(type(error)):
        main(None)


@pytest.mark.parametrize(
    "error", [BlockingIOError(11, "No more processes"), BrokenPipeError(32, "No more processes")]
)
def test_what_the_system_refuses_is_not_taken_for_the_output(
    error: OSError, capsys: pytest.CaptureFixture[str]
) -> None:
    @ending_in_order("mdpo-toy")
    def main(arguments: object = None) -> int:
        raise error

    assert main(None) == 2
    assert capsys.readouterr().err == "mdpo-toy: error: No more processes\n"


def test_no_control_characters_reach_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    @ending_in_order("mdpo-toy")
    def main(arguments: object = None) -> int:
        logging.getLogger("mdpo_rddl").warning("%s has\nchanged", "\x1b]0;mine\x07")
        raise InputError("my.cfg: unknown section [\x1b]0;mine\x07]")

    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    show_log(logging.WARNING, "mdpo-toy: %(message)s")
    assert main(None) == 2
    assert capsys.readouterr().err == (
        "mdpo-toy: \\x1b]0;mine\\x07 has\nchanged\n"
        "mdpo-toy: error: my.cfg: unknown section [\\x1b]0;mine\\x07]\n"
    )


def test_a_file_that_has_nothing_to_say_yet_is_an_error_of_the_systems(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "kmsg"
    path.write_text("x")

    class Silent:
        def __enter__(self) -> "Silent":
            return self

        def __exit__(self, *_: object) -> None:
            """Nothing to close."""

        def read(self, most: int) -> None:
            """As a raw file that would block."""

    monkeypatch.setattr(os, "fdopen", lambda *_: Silent())
    with pytest.raises(BlockingIOError, match="Resource temporarily unavailable"):
        read_bounded(path, 10)


def test_a_user_without_a_home_is_told_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    def home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("XDG_CACHE_HOME", "JAX_COMPILATION_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(cache.Path, "home", home)
    with pytest.raises(InputError, match="set HOME or JAX_COMPILATION_CACHE_DIR"):
        cache.cache_folder()


COMPILING = """
import sys, time
from mdpo_rddl.cli.ending import without_waiting
from mdpo_rddl.machine.background import Background, is_at_work

assert not is_at_work()
assert without_waiting(4) == 4
Background(lambda: [time.sleep(60.0), print("waited", flush=True)])
print("written")
sys.exit(without_waiting(3))
"""


LATE = """
import atexit, os, signal, sys
from mdpo_rddl.cli.ending import without_waiting
atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
sys.exit(without_waiting(0))
"""


def test_an_interrupt_at_the_end_of_python_is_quiet() -> None:
    done = subprocess.run([sys.executable, "-c", LATE], capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")


def test_the_process_does_not_wait_for_a_compilation_that_nobody_needs() -> None:
    done = subprocess.run([sys.executable, "-c", COMPILING], capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (3, b"written\n", b"")


@pytest.mark.parametrize(
    ("variable", "said"),
    [
        ("JAX_PLATFORMS=nonsense", "Unable to initialize backend"),
        ("JAX_NUM_CPU_DEVICES=nonsense", "Invalid value"),
    ],
)
def test_a_variable_that_jax_refuses_is_one_line(
    variable: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_problem(tmp_path)
    monkeypatch.setenv(*variable.split("="))
    status, line = started("plan", "tanks.rddl two.rddl --preset paper --seconds 1", tmp_path)
    assert status == 2
    assert line.startswith(f"mdpo-plan: error: the environment: {said}")
    assert line.count("\n") == 1


def test_a_variable_that_matplotlib_refuses_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "nonsense")
    status, line = started("report", ".", tmp_path)
    assert status == 2
    assert line.startswith("mdpo-report: error: the environment: Key backend: 'nonsense'")
    assert line.count("\n") == 1


def test_a_mistake_of_ours_while_importing_keeps_its_traceback() -> None:
    with pytest.raises(ValueError, match="ours"), ended_at_once():
        exec(compile("raise ValueError('ours')", "x", "exec"), {"__name__": "mdpo_rddl.toy"})
    with pytest.raises(InputError, match="the environment: theirs"), ended_at_once():
        exec(compile("raise ValueError('theirs')", "x", "exec"), {"__name__": "toy"})


TOLD = """
import sys
from mdpo_rddl.cli.ending import ending_in_order
@ending_in_order("mdpo-toy")
def main(arguments=None):
    print("\\u00e9")
    print("\\u00e9", file=sys.stderr)
    return 0
sys.exit(main())
"""


@pytest.mark.parametrize("closed", ["", ">&-", "2>&-", ">&- 2>&-"])
def test_neither_an_encoding_nor_a_missing_stream_ends_a_command(closed: str) -> None:
    done = subprocess.run(
        ["sh", "-c", f'"$0" -c "$1" {closed}', sys.executable, TOLD],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        check=False,
    )
    streams = closed.split()
    assert done.returncode == 0
    assert done.stdout == (b"" if ">&-" in streams else b"\\xe9\n")
    assert done.stderr == (b"" if "2>&-" in streams else b"\\xe9\n")
