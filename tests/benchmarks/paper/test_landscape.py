"""The return over two constant actions: worked by hand, written once, drawn from the file."""

import json

import pytest

from benchmarks.paper import landscape
from benchmarks.paper.figures import draw_landscapes
from benchmarks.paper.landscape import load_landscape, run_landscape
from mdpo_rddl.errors import InputError


def test_the_landscape_has_the_returns_worked_by_hand(tmp_path, monkeypatch):
    monkeypatch.setattr(landscape, "WEIGHTS", (1e4,))
    run_landscape(tmp_path, points=2)
    found = load_landscape(tmp_path)
    assert found.actions.tolist() == [1.0, 6.0]
    exact = found.returns["exact"]
    # 1 unit is below either plant's least: both off, 120 days of shortage
    assert exact[0, 0] == -120000.0
    # 6 units from one plant are too few, and p1's are the dearer: 4 instead of 3 for each
    assert exact[0, 1] < -100000.0
    assert exact[0, 1] - exact[1, 0] == pytest.approx(120 * 6 * (4 - 3))
    # both at full load: never short
    assert exact[1, 1] > -10000.0
    (name,) = set(found.returns) - {"exact"}
    assert name == "w = 10000"
    written = (tmp_path / "landscape.json").read_bytes()
    monkeypatch.setattr(landscape, "build_planner", None)
    run_landscape(tmp_path, points=2)
    assert (tmp_path / "landscape.json").read_bytes() == written
    draw_landscapes(tmp_path / "picture.png", found)
    assert (tmp_path / "picture.png").stat().st_size > 10_000


@pytest.mark.parametrize("content", ["{", "[]", json.dumps({"actions": [1.0]})])
def test_a_file_that_is_no_landscape_is_named(tmp_path, content):
    path = tmp_path / "landscape.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r"landscape.json: is not a landscape of the paper"):
        load_landscape(tmp_path)


def test_a_folder_without_a_landscape_has_none(tmp_path):
    assert load_landscape(tmp_path) is None
