"""The run folder: complete, or not there at all."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.files import contents
from helpers.mistakes import one_line

from mdpo_rddl.errors import InputError
from mdpo_rddl.session.report.run_folder import SUMMARY, RunFolder, free_name


def write_run(folder: RunFolder, text: str = "{}") -> None:
    (folder.staging / SUMMARY).write_text(text)
    (folder.staging / "history.csv").write_text("iteration\n")


def fail(target: Path, error: type[BaseException]) -> None:
    """A run that ends with an error."""
    with RunFolder(target) as folder:
        write_run(folder)
        assert folder.staging.parent == target.with_name(f"{target.name}.unfinished")
        raise error


def refused(target: Path) -> str:
    message = one_line(lambda: RunFolder(target))
    assert message.startswith(f"{target}: ")
    return message.removeprefix(f"{target}: ")


def test_a_committed_run_is_all_that_is_left(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "deep" / "er" / "run") as folder:
        write_run(folder)
        assert not (tmp_path / "deep" / "er" / "run").exists()
        folder.commit()
    assert contents(tmp_path) == {
        "deep": None,
        "deep/er": None,
        "deep/er/run": None,
        "deep/er/run/history.csv": b"iteration\n",
        "deep/er/run/summary.json": b"{}",
    }


def test_a_run_in_an_empty_folder(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with RunFolder(tmp_path / "run") as folder:
        write_run(folder)
        folder.commit()
    assert set(contents(tmp_path)) == {"run", "run/history.csv", "run/summary.json"}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, InputError])
def test_nothing_is_left_of_a_run_that_failed(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error):
        fail(tmp_path / "deep" / "er" / "run", error)
    assert contents(tmp_path) == {}


def test_nothing_is_left_without_a_commit(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        write_run(folder)
    assert contents(tmp_path) == {}


def test_a_failed_run_leaves_what_others_have_put_beside_it(tmp_path: Path) -> None:
    first = RunFolder(tmp_path / "runs" / "a")
    with RunFolder(tmp_path / "runs" / "b") as other:
        write_run(other)
        other.commit()
    with first:
        write_run(first)
    assert set(contents(tmp_path)) == {
        "runs",
        "runs/b",
        "runs/b/history.csv",
        "runs/b/summary.json",
    }


def test_an_empty_folder_that_was_there_before_stays(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    with RunFolder(tmp_path / "runs" / "run") as folder:
        write_run(folder)
    assert contents(tmp_path) == {"runs": None}


def earlier_run(target: Path) -> dict[str, bytes | None]:
    target.mkdir()
    (target / SUMMARY).write_text('{"old": 1}')
    (target / "config.json").write_text("mine")
    return contents(target)


def test_an_earlier_run_is_replaced_by_the_commit_and_not_before(tmp_path: Path) -> None:
    target = tmp_path / "run"
    before = earlier_run(target)
    with RunFolder(target) as folder:
        write_run(folder, '{"new": 1}')
        assert contents(target) == before
        folder.commit()
        assert contents(target) == {SUMMARY: b'{"new": 1}', "history.csv": b"iteration\n"}
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_an_earlier_run_outlives_a_run_that_failed(tmp_path: Path) -> None:
    target = tmp_path / "run"
    before = earlier_run(target)
    with pytest.raises(RuntimeError):
        fail(target, RuntimeError)
    assert contents(target) == before
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


@pytest.mark.parametrize(
    ("error", "reported", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), InputError, "No space left on device"),
        (KeyboardInterrupt(), KeyboardInterrupt, "^$"),
    ],
)
def test_an_earlier_run_outlives_a_commit_that_failed(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    reported: type[BaseException],
    said: str,
) -> None:
    target = tmp_path / "run"
    before = earlier_run(target)
    replace = os.replace

    def replace_all_but_the_staging_folder(source: Path, destination: Path) -> None:
        if source == folder.staging:
            raise error
        replace(source, destination)

    monkeypatch.setattr(os, "replace", replace_all_but_the_staging_folder)
    with RunFolder(target) as folder:
        write_run(folder)
        with pytest.raises(reported, match=said):
            folder.commit()
    assert contents(target) == before
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_a_full_disk_is_bad_input_that_names_the_folder(tmp_path: Path) -> None:
    target = tmp_path / "run"
    with RunFolder(target) as folder, pytest.raises(InputError) as caught, folder.writing():
        raise OSError(errno.ENOSPC, "No space left on device")
    assert str(caught.value) == f"{target}: cannot write the run there: No space left on device"
    assert contents(tmp_path) == {}


def test_a_folder_of_something_else_is_refused_untouched(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("x")
    before = contents(tmp_path)
    assert refused(tmp_path / "thesis") == "not overwritten: it is not empty and holds no run"
    assert contents(tmp_path) == before


def test_a_file_is_refused_untouched(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("x")
    assert refused(tmp_path / "run") == "cannot write the run there: it is a file"
    assert contents(tmp_path) == {"run": b"x"}


def test_a_link_to_nowhere_is_refused_untouched(tmp_path: Path) -> None:
    (tmp_path / "run").symlink_to(tmp_path / "nowhere")
    assert refused(tmp_path / "run") == "cannot write the run there: it is a link"
    assert os.readlink(tmp_path / "run") == str(tmp_path / "nowhere")
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize(
    ("below", "cause"),
    [("run", "File exists"), ("a/run", "Not a directory"), ("a/b/run", "Not a directory")],
)
def test_a_file_in_the_way_is_refused_untouched(tmp_path: Path, below: str, cause: str) -> None:
    (tmp_path / "file").write_text("x")
    assert refused(tmp_path / "file" / below) == f"cannot write the run there: {cause}"
    assert contents(tmp_path) == {"file": b"x"}


@pytest.mark.parametrize("parent", ["", "new/er"])
def test_a_name_that_the_file_system_refuses(tmp_path: Path, parent: str) -> None:
    reason = refused(tmp_path / parent / ("a" * 300))
    assert reason == "cannot write the run there: File name too long"
    assert contents(tmp_path) == {}


def test_the_folder_one_is_in_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "a" / "b")
    for target in (Path("."), Path(".."), tmp_path / "a" / "b", tmp_path / "a", Path("/")):
        assert refused(target) == "cannot write the run there: name a folder inside it"
    assert contents(tmp_path) == {"a": None, "a/b": None}


def test_free_name_counts_up_from_the_stem(tmp_path: Path) -> None:
    assert free_name(tmp_path / "runs", "hvac10-seed0") == tmp_path / "runs" / "hvac10-seed0"
    (tmp_path / "hvac10-seed0").mkdir()
    assert free_name(tmp_path, "hvac10-seed0") == tmp_path / "hvac10-seed0-2"
    (tmp_path / "hvac10-seed0-2").write_text("a file takes a name as well")
    (tmp_path / "hvac10-seed0-4").mkdir()
    assert free_name(tmp_path, "hvac10-seed0") == tmp_path / "hvac10-seed0-3"
    (tmp_path / "hvac10-seed0-3").symlink_to(tmp_path / "nowhere")
    assert free_name(tmp_path, "hvac10-seed0") == tmp_path / "hvac10-seed0-5"
    assert free_name(tmp_path, "hvac10-seed1") == tmp_path / "hvac10-seed1"


def test_a_folder_with_anything_else_beside_a_summary_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "thesis"
    before = earlier_run(target)
    (target / "chapter1.tex").write_text("years of work")
    assert refused(target) == "not overwritten: it also holds chapter1.tex"
    assert contents(target) == before | {"chapter1.tex": b"years of work"}


def test_a_folder_is_one_run_s_at_a_time(tmp_path: Path) -> None:
    target = tmp_path / "run"
    with RunFolder(target) as folder:
        assert refused(target) == f"already in use by process {os.getpid()}"
        write_run(folder)
        folder.commit()
    with RunFolder(target) as folder:
        write_run(folder, '{"run": 2}')
        folder.commit()
    assert contents(tmp_path / "run")[SUMMARY] == b'{"run": 2}'
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


HOLDS_THE_LOCK = """
import os, sys
from pathlib import Path
from mdpo_rddl.session.report.run_folder import RunFolder
with RunFolder(Path(sys.argv[1])) as folder:
    (folder.unfinished / "checkpoint-0.safetensors").write_bytes(b"kept")
    print(os.getpid(), flush=True)
    sys.stdin.read()
"""


def test_a_killed_process_holds_no_lock_and_leaves_its_checkpoints(tmp_path: Path) -> None:
    target = tmp_path / "run"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS_THE_LOCK, str(target)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        owner = process.stdout.readline().strip()
        assert refused(target) == f"already in use by process {owner}"
        process.kill()
        process.wait()
    message = one_line(lambda: RunFolder(target))
    assert message == (
        f"{target}.unfinished: holds an unfinished run, which --resume goes on with; "
        "delete it to begin anew"
    )
    # killed while it wrote
    (tmp_path / "run.unfinished" / ".checkpoint-1.safetensors-ab12_xyz").write_bytes(b"half")
    with RunFolder(target, resume=True) as folder:
        assert folder.checkpoints == ["checkpoint-0.safetensors"]
        write_run(folder)
        folder.commit()
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_a_run_that_is_not_finished_keeps_its_checkpoints(tmp_path: Path) -> None:
    target = tmp_path / "run"
    with RunFolder(target) as folder:
        write_run(folder)
        (folder.unfinished / "checkpoint-1.safetensors").write_bytes(b"kept")
        folder.commit(is_finished=False)
    assert set(contents(tmp_path)) == {
        "run",
        "run/history.csv",
        "run/summary.json",
        "run.unfinished",
        "run.unfinished/checkpoint-1.safetensors",
    }
    assert free_name(tmp_path, "run") == tmp_path / "run-2"
    with RunFolder(target, resume=True) as folder:
        write_run(folder, '{"run": 2}')
        folder.commit()
    assert {path.name for path in tmp_path.iterdir()} == {"run"}
    assert contents(target)[SUMMARY] == b'{"run": 2}'


def test_what_is_not_ours_in_the_way_is_left_alone(tmp_path: Path) -> None:
    target, other = tmp_path / "run", tmp_path / "run.unfinished"
    other.mkdir()
    (other / "chapter.tex").write_text("x")
    message = one_line(lambda: RunFolder(target))
    assert message == f"{other}: is in the way: it also holds chapter.tex"
    assert set(contents(tmp_path)) == {"run.unfinished", "run.unfinished/chapter.tex"}


def test_killed_between_two_renames_the_earlier_run_is_put_back(tmp_path: Path) -> None:
    before = earlier_run(tmp_path / "run")
    (tmp_path / "run.unfinished").mkdir()
    (tmp_path / "run").rename(tmp_path / "run.unfinished" / "replaced")
    with RunFolder(tmp_path / "run"):
        pass
    assert contents(tmp_path / "run") == before
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_a_finished_run_has_nothing_to_resume(tmp_path: Path) -> None:
    target = tmp_path / "run"
    earlier_run(target)
    message = one_line(lambda: RunFolder(target, resume=True))
    assert message == f"{target}: the run there is finished, nothing is left to resume"
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_what_appears_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    target = tmp_path / "run"
    with RunFolder(target) as one:
        write_run(one, '{"run": 1}')
        target.mkdir()
        (target / SUMMARY).write_text('{"run": 2}')
        one.commit()
    assert contents(tmp_path / "run")[SUMMARY] == b'{"run": 2}'
    assert contents(tmp_path / "run-2")[SUMMARY] == b'{"run": 1}'
    assert {path.name for path in tmp_path.iterdir()} == {"run", "run-2"}


def test_what_is_put_into_an_earlier_run_meanwhile_is_not_lost(tmp_path: Path) -> None:
    target = tmp_path / "run"
    earlier_run(target)
    with RunFolder(target) as folder:
        write_run(folder, '{"new": 1}')
        (target / "thesis").mkdir()
        (target / "thesis" / "x.tex").write_text("x")
        before = contents(target)
        folder.commit()
    assert contents(target) == before
    assert contents(tmp_path / "run-2")[SUMMARY] == b'{"new": 1}'
    assert {path.name for path in tmp_path.iterdir()} == {"run", "run-2"}
