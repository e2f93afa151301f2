"""Links where a run is to go: nothing that they lead to is lost, and no run either."""

import os
from pathlib import Path

import pytest
from helpers.files import contents
from helpers.mistakes import one_line

from mdpo_rddl.session.report.run_folder import SUMMARY, RunFolder


def write_run(target: Path, text: str = "{}") -> None:
    with RunFolder(target) as folder:
        (folder.staging / SUMMARY).write_text(text)
        folder.commit()


@pytest.mark.parametrize("leads_to", ["real", "nowhere", "link"])
def test_a_link_in_the_place_of_the_run_is_refused_at_once(tmp_path: Path, leads_to: str) -> None:
    write_run(tmp_path / "real")
    link = tmp_path / "link"
    link.symlink_to(leads_to)
    before = contents(tmp_path)
    assert one_line(lambda: RunFolder(link)) == f"{link}: cannot write the run there: it is a link"
    assert contents(tmp_path) == before
    assert os.readlink(link) == leads_to


def test_a_link_on_the_way_to_the_run_is_followed(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "runs").symlink_to("disk")
    for text in ("{}", '{"second": 1}'):
        write_run(tmp_path / "runs" / "a", text)
    assert (tmp_path / "disk" / "a" / SUMMARY).read_text() == '{"second": 1}'
    assert os.listdir(tmp_path / "disk") == ["a"]


def test_what_a_link_named_unfinished_leads_to_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "victim" / "staging").mkdir(parents=True)
    (tmp_path / "victim" / "staging" / "precious").write_text("x")
    unfinished = tmp_path / "a.unfinished"
    unfinished.symlink_to("victim")
    before = contents(tmp_path)
    said = one_line(lambda: RunFolder(tmp_path / "a"))
    assert said == f"{unfinished}: cannot write the run there: it is a link"
    assert contents(tmp_path) == before


@pytest.mark.parametrize("kind", ["link", "file"])
@pytest.mark.parametrize("name", ["staging", "replaced"])
def test_what_is_no_folder_in_the_unfinished_one_is_removed(
    tmp_path: Path, name: str, kind: str
) -> None:
    write_run(tmp_path / "a", '{"first": 1}')
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / "precious").write_text("x")
    in_the_way = tmp_path / "a.unfinished" / name
    in_the_way.parent.mkdir()
    if kind == "link":
        in_the_way.symlink_to(tmp_path / "victim")
    else:
        in_the_way.write_text("x")
    write_run(tmp_path / "a")
    assert contents(tmp_path) == {
        "a": None,
        f"a/{SUMMARY}": b"{}",
        "victim": None,
        "victim/precious": b"x",
    }


def test_a_link_left_by_an_earlier_version_does_not_become_the_run(tmp_path: Path) -> None:
    (tmp_path / "victim").mkdir()
    (tmp_path / "a.unfinished").mkdir()
    (tmp_path / "a.unfinished" / "replaced").symlink_to(tmp_path / "victim")
    write_run(tmp_path / "a")
    assert not (tmp_path / "a").is_symlink()
    assert set(contents(tmp_path)) == {"a", f"a/{SUMMARY}", "victim"}
