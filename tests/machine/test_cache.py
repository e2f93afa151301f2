"""The cache is bounded in size, and can be cleared."""

import os
from pathlib import Path

import pytest
from helpers.files import contents

from mdpo_rddl.cli.options import plan_parser
from mdpo_rddl.machine.cache import bound_cache, clear_cache

OLD = "traced/" + "0f" * 32
FILES = [f"jit_f-{'0f' * 32}-cache", OLD, "grammar-tables"]


def fill(folder: Path) -> None:
    (folder / "traced").mkdir(parents=True)
    for age, name in enumerate(FILES):
        (folder / name).write_bytes(b"x" * 10)
        os.utime(folder / name, (10**9 - age, 10**9 - age))
    (folder / "thesis.tex").write_bytes(b"not a program")
    (folder / "traced" / "notes").write_bytes(b"nor this")


def left(folder: Path) -> set[str]:
    # by their names: to read a file is to use it
    names = {str(path.relative_to(folder)) for path in folder.rglob("*")}
    return names - {"traced", "thesis.tex", "traced/notes"}


def test_what_was_not_used_for_the_longest_time_goes_first(tmp_path: Path) -> None:
    fill(tmp_path)
    assert bound_cache(tmp_path, 30) == (0, 0)
    assert bound_cache(tmp_path, 20) == (1, 10)
    assert left(tmp_path) == {FILES[0], OLD}
    assert bound_cache(tmp_path, 19) == (1, 10)
    assert left(tmp_path) == {FILES[0]}
    assert bound_cache(tmp_path / "no", 1) == (0, 0)


def test_clearing_leaves_what_is_no_program(tmp_path: Path) -> None:
    fill(tmp_path)
    assert clear_cache(tmp_path) == (3, 30)
    assert set(contents(tmp_path)) == {"traced", "thesis.tex", "traced/notes"}
    assert clear_cache(tmp_path) == (0, 0)


def test_the_command_clears_the_cache_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "cache"))
    fill(tmp_path / "cache")
    with pytest.raises(SystemExit) as end:
        plan_parser().parse_args(["--clear-cache"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"{tmp_path}/cache: 3 files removed, 0.0 MB\n"
    assert left(tmp_path / "cache") == set()
