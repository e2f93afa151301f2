"""The grammar's tables on disk: read where they are good, replaced where not, never needed."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from helpers.problems import ROOT
from ply import yacc

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem import load
from mdpo_rddl.problem.load import load_problem

FILES = str(ROOT / "domains/reservoir.rddl"), str(ROOT / "instances/reservoir15.rddl")


@pytest.fixture
def built(monkeypatch):
    """How often the tables were built, in a process that never parses twice with one parser."""
    times = []

    class Counting(yacc.LRGeneratedTable):
        def __init__(self, *arguments):
            times.append(1)
            super().__init__(*arguments)

    monkeypatch.setattr(yacc, "LRGeneratedTable", Counting)
    return times


@pytest.fixture(autouse=True)
def _new_parsers(monkeypatch):
    monkeypatch.setattr(load, "_parser", load._Parser)


def test_the_second_run_reads_what_the_first_has_built(tmp_path: Path, built) -> None:
    tables = tmp_path / "new" / "tables"
    first, second = (load_problem(*FILES, tables=tables) for _ in range(2))
    assert len(built) == 1
    assert first.digest == second.digest
    assert first.model.cpfs.keys() == second.model.cpfs.keys()
    assert [path.name for path in tables.parent.iterdir()] == ["tables"]


@pytest.mark.parametrize("content", [b"", b"no pickle", b"\x80\x05"])
def test_a_damaged_file_is_replaced(tmp_path: Path, built, content: bytes) -> None:
    tables = tmp_path / "tables"
    tables.write_bytes(content)
    for _ in range(2):
        load_problem(*FILES, tables=tables)
    assert len(built) == 1


def test_a_folder_that_cannot_be_written_costs_only_time(tmp_path: Path, built) -> None:
    (tmp_path / "file").write_text("in the way")
    for _ in range(2):
        load_problem(*FILES, tables=tmp_path / "file" / "tables")
    assert len(built) == 2


def test_a_thread_builds_its_parser_once(built, monkeypatch) -> None:
    monkeypatch.undo()
    monkeypatch.delattr(load._of_thread, "parser", raising=False)
    parsers = [load._parser(None) for _ in range(2)]
    assert parsers[0] is parsers[1]
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(load._parser, None).result() is not parsers[0]


def test_a_syntax_error_leaves_the_parser_as_it_was(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.undo()
    digest = load_problem(*FILES).digest
    (tmp_path / "broken.rddl").write_text("domain d { types { a : object; }; cpfs { x' = (1 +")
    with pytest.raises(InputError, match="syntax error"):
        load_problem(str(tmp_path / "broken.rddl"), FILES[1])
    assert load_problem(*FILES).digest == digest
