"""Records of measurements: rows as they come, read again, and other files left alone."""

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.mistakes import one_line

from benchmarks.common.records import Records

COLUMNS = ("name", "seed", "value")


def test_records_write_each_row_at_once_and_go_on_from_it(tmp_path):
    path = tmp_path / "new" / "folder" / "rows.csv"
    records = Records(path, COLUMNS, COLUMNS[:2])
    assert path.read_text() == "name,seed,value\n"
    records.add("a", 0, 0.1)
    assert path.read_bytes() == b"name,seed,value\na,0,0.1\n"
    records.add("b,c", 1, 1e-300)

    resumed = Records(path, COLUMNS, COLUMNS[:2])
    assert resumed.rows == records.rows
    assert resumed.rows[1] == {"name": "b,c", "seed": "1", "value": "1e-300"}
    assert resumed.has("a", 0)
    assert resumed.has("b,c", 1)
    assert not resumed.has("a", 1)
    assert not resumed.has("b", 1)
    resumed.add("a", 1, 2.0)
    assert path.read_bytes() == b'name,seed,value\na,0,0.1\n"b,c",1,1e-300\na,1,2.0\n'


def test_numbers_survive_the_file_to_the_last_digit(tmp_path):
    value = float(np.nextafter(-1371468.0, 0.0))
    Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2]).add("a", 0, value)
    (row,) = Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2]).rows
    assert float(row["value"]) == value


def test_a_row_of_the_wrong_length_is_not_written(tmp_path):
    records = Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2])
    with pytest.raises(ValueError, match="zip"):
        records.add("a", 0)
    assert records.rows == []
    assert (tmp_path / "rows.csv").read_text() == "name,seed,value\n"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"name,value\n", "{path}: holds other results (columns name, value)"),
        (b"name,value,seed\n", "{path}: holds other results (columns name, value, seed)"),
        (b"name,seed,value\na,0,1\nb,0\n", "{path}:3: is not a whole row; delete the line"),
        (b"name,seed,value\na,0,1,2\n", "{path}:2: is not a whole row; delete the line"),
        (b"name,seed,value\na,0,1", "{path}:2: the line has no end; delete or end it"),
        (b"\xff\xfe\x00", "{path}: is not a CSV file of results"),
    ],
)
def test_a_file_of_anything_else_is_refused_and_left_alone(tmp_path, content, complaint):
    path = tmp_path / "rows.csv"
    path.write_bytes(content)
    assert one_line(lambda: Records(path, COLUMNS, COLUMNS[:2])) == complaint.format(path=path)
    assert path.read_bytes() == content


def test_rows_with_the_line_ends_of_windows_are_read(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_bytes(b"name,seed,value\na,0,1\r\nb,0,2\r\n")
    assert [row["value"] for row in Records(path, COLUMNS, COLUMNS[:2]).rows] == ["1", "2"]


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    beneath_a_file = tmp_path / "file" / "rows.csv"
    message = one_line(lambda: Records(beneath_a_file, COLUMNS, COLUMNS[:2]))
    assert message.startswith(f"{beneath_a_file}: cannot be written: ")
    (tmp_path / "rows.csv").mkdir()
    message = one_line(lambda: Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2]))
    assert message == f"{tmp_path / 'rows.csv'}: cannot be written: Is a directory"


def test_a_file_that_can_only_be_read_is_refused_before_anything_is_trained(tmp_path, monkeypatch):
    path = tmp_path / "rows.csv"
    path.write_text("name,seed,value\n")
    opened = Path.open

    def read_only(self: Path, mode: str = "r", **kwargs: Any) -> Any:
        if set(mode) & set("wa+"):
            raise PermissionError(13, "Permission denied")
        return opened(self, mode, **kwargs)

    monkeypatch.setattr(Path, "open", read_only)
    message = one_line(lambda: Records(path, COLUMNS, COLUMNS[:2]))
    assert message == f"{path}: cannot be written: Permission denied"


WRITER = """
import itertools, os, sys
from pathlib import Path
from benchmarks.common.records import Records

records = Records(Path(sys.argv[1]), ("name", "seed", "value"), ("name", "seed"))
for number in itertools.count(len(records.rows)):
    records.add(number, 0, "x" * 50_000)
    os.write(1, b"%d\\n" % number)
"""


def test_a_kill_in_the_middle_of_a_row_loses_no_finished_one(tmp_path):
    path, variables = tmp_path / "rows.csv", {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    for more in (1, 7, 20):
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, env=variables
        ) as writer:
            told = [int(line) for line in itertools.islice(writer.stdout, more)]
            writer.kill()
            told += [int(line) for line in writer.stdout]
        rows = Records(path, COLUMNS, COLUMNS[:2]).rows
        assert [int(row["name"]) for row in rows] == list(range(len(rows)))
        # the one that was being told may be there
        assert told[-1] + 1 <= len(rows) <= told[-1] + 2
        assert {len(row["value"]) for row in rows} == {50_000}


def test_who_only_reads_leaves_the_conditions_of_a_run_that_has_no_row_yet(tmp_path):
    path = tmp_path / "rows.csv"
    Records(path, COLUMNS, COLUMNS[:2], {"seconds": 60})
    Records(path, COLUMNS, COLUMNS[:2])
    assert json.loads(path.with_suffix(".json").read_text()) == {"seconds": 60}
