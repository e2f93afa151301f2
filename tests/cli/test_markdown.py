"""Markdown in a terminal and in a pipe."""

import sys

import pytest

from mdpo_rddl.cli.markdown import print_markdown, table_width

TABLE = "| planner | score |\n|---|---:|\n| noop | 0.000 |\n"
TEXT = f"# Scores\n\n{TABLE}\n![Scores](scores.png)\n"


@pytest.fixture
def _terminal(capsys, monkeypatch):
    monkeypatch.setattr(type(sys.stdout), "isatty", lambda _: True)
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setenv("NO_COLOR", "1")


def test_a_pipe_gets_the_text_as_it_is(capsys):
    print_markdown(TEXT)
    assert capsys.readouterr().out == TEXT


@pytest.mark.usefixtures("_terminal")
def test_a_terminal_gets_a_table_and_no_pictures(capsys):
    print_markdown(TEXT)
    shown = capsys.readouterr().out
    assert "noop" in shown
    assert "0.000" in shown
    assert "|---" not in shown
    assert "scores.png" not in shown


@pytest.mark.usefixtures("_terminal")
def test_no_figure_is_cut_off_where_a_table_is_too_wide(capsys):
    wide = TEXT.replace("0.000", "0" * 60)
    print_markdown(wide)
    assert capsys.readouterr().out == wide


def test_the_width_is_that_of_the_widest_cells():
    assert table_width(TABLE) == len("planner") + len("score") + 4
    assert table_width("no table") == 0
