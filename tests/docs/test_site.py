"""The pages of the site: what commands write is what they would write, and nothing is left out."""

import importlib.util
import re
import subprocess
import sys

import pytest
import yaml
from helpers.problems import ROOT

import mdpo_rddl

DOCS = ROOT / "docs"
PAGES = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}


def places(tree):
    """The pages of a navigation."""
    if isinstance(tree, str):
        return [tree]
    parts = tree.values() if isinstance(tree, dict) else tree
    return [place for part in parts for place in places(part)]


def test_every_page_is_in_the_navigation_once():
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    named = places(config["nav"])
    assert len(named) == len(set(named))
    # the README, the changelog and the page for contributors lie outside of docs/
    assert set(named) == PAGES | {"index.md", "CHANGELOG.md", "CONTRIBUTING.md"}


@pytest.mark.parametrize("tool", ["write_results.py", "draw_gallery.py"])
def test_a_written_page_is_what_its_command_writes(tool):
    done = subprocess.run([sys.executable, str(ROOT / "tools" / tool), "--check"], check=False)
    assert done.returncode == 0, f"run: python tools/{tool}"


def test_the_api_page_has_every_public_name():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    for name in mdpo_rddl.__all__:
        assert re.search(rf"^::: mdpo_rddl\.{name}$|`{name}`", page, flags=re.MULTILINE), name


def test_the_tutorial_shows_the_files_of_the_example():
    page = (DOCS / "tutorials" / "control.md").read_text(encoding="utf-8")
    shown = re.findall(r"```rddl\n(.*?)```", page, flags=re.DOTALL)
    names = ("room.rddl", "three.rddl")
    folder = ROOT / "examples" / "room"
    assert shown == [(folder / name).read_text(encoding="utf-8") for name in names]


def test_every_local_link_leads_to_a_file():
    for page in [ROOT / "README.md", *DOCS.rglob("*.md")]:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for link in re.findall(r"\]\(([^)\s#]+)[^)]*\)", text):
            assert "://" in link or (page.parent / link).exists(), f"{page.name}: {link}"


@pytest.fixture
def writer(tmp_path, monkeypatch):
    """The module that writes the page of results, for a copy of its folder."""
    spec = importlib.util.spec_from_file_location("writer", ROOT / "tools" / "write_results.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    results = tmp_path / "results"
    results.mkdir()
    for path in (ROOT / "results").iterdir():
        (results / path.name).symlink_to(path)
    monkeypatch.setattr(module, "RESULTS", results)
    return module


def test_rows_that_name_their_commit_need_no_other_source(writer):
    published = writer.RESULTS / "published"
    published.unlink(missing_ok=True)
    published.mkdir()
    (published / "rows.csv").write_text("problem,commit\nA,abc1234\n")
    (published / "table.md").write_text("| problem | ours |\n|---|---|\n| A | 1 |\n")
    page = writer.page()
    assert "## Tasks with published returns" in page
    assert "| A | 1 | `python -m benchmarks published` | abc1234 |" in page
    assert "<!--" not in page


def test_a_folder_of_which_nobody_names_the_commit_is_an_error(writer):
    (writer.RESULTS / "mystery").mkdir()
    with pytest.raises(KeyError, match="neither its rows nor"):
        writer.page()
