"""The JSON files of a run folder."""

import json
from pathlib import Path

import pytest

from mdpo_rddl.session.report.run_folder import write_json


def test_json_is_readable_and_ends_with_a_line(tmp_path: Path) -> None:
    value = {"a": [1, 2.5, None, "\u03c3"], "b": {"c": True}}
    write_json(tmp_path / "x.json", value)
    text = (tmp_path / "x.json").read_text(encoding="utf-8")
    assert json.loads(text) == value
    assert text.endswith("}\n")
    assert '\n  "b"' in text


def test_literals_that_json_lacks_are_written_as_lists_and_text(tmp_path: Path) -> None:
    write_json(tmp_path / "x.json", {"set": {"b", "a"}, "tuple": (1, 2), "bytes": b"x"})
    written = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert written == {"set": ["a", "b"], "tuple": [1, 2], "bytes": "b'x'"}


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_that_json_lacks_are_refused(tmp_path: Path, value: float) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "x.json", {"a": value})
    assert not (tmp_path / "x.json").exists()
