"""A picture replaces the one before in one step."""

from pathlib import Path

import pytest
from helpers.mistakes import one_line
from matplotlib.figure import Figure

from mdpo_rddl.machine.pictures import literal, write_picture


def test_a_picture_is_written_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.png"
    write_picture(Figure((1.0, 2.0)), path, dpi=50)
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG")
    # width and height of the head: 50 and 100
    assert content[16:24] == bytes([0, 0, 0, 50, 0, 0, 0, 100])
    assert [each.name for each in path.parent.iterdir()] == ["a.png"]


def test_what_fails_on_the_way_leaves_the_picture_that_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"before")

    def fill_up(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mdpo_rddl.machine.files.os.fsync", fill_up)
    message = one_line(lambda: write_picture(Figure((1.0, 1.0)), path, dpi=50))
    assert message == f"{path}: cannot be written: No space left on device"
    assert path.read_bytes() == b"before"
    assert [each.name for each in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("name", [r"x$\foo$", r"\$a$", "$$$", "plain"])
def test_a_name_is_no_formula(name: str, tmp_path: Path) -> None:
    figure = Figure((2.0, 1.0))
    axes = figure.subplots()
    axes.plot([0], [0], label=literal(name))
    text = axes.legend().get_texts()[0]
    write_picture(figure, tmp_path / "a.png", dpi=50)  # where formulas are read
    assert text._preprocess_math(text.get_text()) == (name, False)
