"""Files from anybody are read within bounds, and files of ours are there as a whole."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.mistakes import one_line

from mdpo_rddl.machine import files
from mdpo_rddl.machine.files import append, read_bounded, read_json, write_atomically


def test_what_is_read_is_what_the_file_holds(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bounded(path, 5) == b"12345"
    assert read_bounded(path, 5, tmp_path) == b"12345"


def test_a_larger_file_is_refused_with_the_bound(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"123456")
    said = f"{path}: is larger than 5 bytes, the most to be read"
    assert one_line(lambda: read_bounded(path, 5)) == said


def test_a_sparse_terabyte_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with path.open("wb") as file:
        try:
            file.truncate(2**40)
        except OSError:
            file.truncate(2**33)  # as much as this file system can
    assert one_line(lambda: read_bounded(path, 2**20)).endswith(
        "larger than 1 MiB, the most to be read"
    )


def test_a_device_and_a_pipe_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/zero"), Path("/dev/null"), tmp_path / "pipe"):
        assert (
            one_line(lambda path=path: read_bounded(path, 10)) == f"{path}: is not a regular file"
        )


def test_a_file_that_says_it_is_empty_is_bounded_too() -> None:
    path = Path("/proc/self/status")
    assert path.stat().st_size == 0
    assert read_bounded(path, 2**20)
    assert "larger than 10 bytes" in one_line(lambda: read_bounded(path, 10))


def test_a_link_may_lead_within_the_folder_but_not_out_of_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "mine").write_bytes(b"x")
    (tmp_path / "others").write_bytes(b"y")
    (folder / "inside").symlink_to("mine")
    (folder / "outside").symlink_to("../others")
    assert read_bounded(folder / "inside", 9, folder) == b"x"
    said = one_line(lambda: read_bounded(folder / "outside", 9, folder))
    assert said == f"{folder / 'outside'}: is a link that leads out of {folder}"
    assert read_bounded(folder / "outside", 9) == b"y"


def test_folders_and_missing_files_are_the_system_s_errors(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        read_bounded(tmp_path, 9)
    with pytest.raises(FileNotFoundError):
        read_bounded(tmp_path / "no", 9)


def test_json_that_is_nested_too_deeply_is_no_json(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("[" * 100_000)
    with pytest.raises(ValueError, match="nested too deeply"):
        read_json(path)


def full(*arguments: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO])
def test_a_full_disk_leaves_the_last_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    path = tmp_path / "a"
    write_atomically(path, "old")
    monkeypatch.setattr(files.os, "fsync", refuse)
    said = one_line(lambda: write_atomically(path, "new"))
    assert said == f"{path}: cannot be written: {os.strerror(number)}"
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == {"a": "old"}


def test_a_row_is_added_as_a_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"one\n")
    append(path, b"two\n")
    monkeypatch.setattr(files.os, "fsync", full)
    assert "No space left" in one_line(lambda: append(path, b"three\n"))
    assert path.read_bytes() == b"one\ntwo\n"


@pytest.mark.parametrize("write", [write_atomically, append])
def test_a_removed_folder_is_said(tmp_path: Path, write: Callable[[Path, bytes], None]) -> None:
    (tmp_path / "file").write_bytes(b"")
    said = one_line(lambda: write(tmp_path / "file" / "a", b"x"))
    assert said.startswith(f"{tmp_path}/file/a: cannot be written: ")


def test_a_device_or_a_pipe_does_not_lose_its_name_to_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    for name in ("pipe", "null"):
        path = tmp_path / name
        said = one_line(lambda path=path: write_atomically(path, "x"))
        assert said == f"{path}: cannot be written: is not a regular file"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["null", "pipe"]
    assert (tmp_path / "pipe").is_fifo()
    assert (tmp_path / "null").is_symlink()


def test_a_link_is_replaced_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "theirs").write_text("theirs")
    for target in ("theirs", "missing"):
        path = tmp_path / f"to-{target}"
        path.symlink_to(target)
        write_atomically(path, "ours")
        assert (path.read_text(), path.is_symlink()) == ("ours", False)
    assert (tmp_path / "theirs").read_text() == "theirs"
