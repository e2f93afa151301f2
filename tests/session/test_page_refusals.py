"""Run folders that are damaged, or from anybody: one line, and no page."""

import zipfile

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.run_pages import FLUENTS, write_run

from mdpo_rddl.problem.trajectories import Trajectories
from mdpo_rddl.session.report.page.record import write_play
from mdpo_rddl.session.report.page.write import write_page


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("summary.json", "{", "summary.json: damaged: "),
        ("summary.json", "{}", "summary.json: not a run's summary: it has no 'label'"),
        ("trajectories.npz", "PK", "trajectories.npz: damaged: "),
        ("config.json", "]", "config.json: damaged: "),
    ],
)
def test_a_damaged_run_is_told_in_a_line(tmp_path, name, content, said):
    folder = write_run(tmp_path / "run")
    (folder / name).write_text(content)
    assert one_line(lambda: write_page(folder)).startswith(f"{folder}/{said}")
    assert not (folder / "report.html").exists()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"returns": "x"}, "returns is 'x', not a list"),
        ({"returns": []}, "returns is a list, not a list of 1 or more"),
        ({"returns": [1.0, True]}, "returns[1] is True, not a number"),
        ({"mean_return": 10**400}, "mean_return is too large, not a number"),
        ({"mean_return": float("inf")}, "mean_return is inf, not a number"),
        ({"label": None}, "label is null, not a text"),
        ({"label": "\ud800"}, "label is '\\ud800', not a text in Unicode"),
        ({"ci95": [1.0]}, "ci95 is a list, not a list of 2"),
        ({"noise_parameters": 3}, "noise_parameters is 3, not a table"),
        ({"references": {"noop": {}}}, "references.'noop' has no 'returns'"),
        ({"warnings": [["a"]]}, "warnings[0] is a list, not a text"),
        ({"auto": 3}, "auto is 3, not a table"),
        ({"auto": {"arms": {}}}, "auto has no 'arm'"),
        ({"rule": {"equations": [3], "note": ""}}, "rule.equations[0] is 3, not a table"),
        ({"train_seconds": 1.0}, "it has no 'compile_seconds'"),
    ],
)
def test_a_value_of_another_kind_is_named(tmp_path, changes, said):
    folder = write_run(tmp_path / "run", **changes)
    message = one_line(lambda: write_page(folder))
    assert message == f"{folder}/summary.json: not a run's summary: {said}"


def test_a_configuration_of_another_kind_is_named(tmp_path):
    folder = write_run(tmp_path / "run")
    (folder / "config.json").write_text('{"sections": {"Noise": 3}}')
    message = one_line(lambda: write_page(folder))
    said = "config.json: not a run's configuration: sections.'Noise' is 3, not a table"
    assert message == f"{folder}/{said}"


def test_texts_of_strangers_are_told_in_a_line_without_control_characters(tmp_path):
    folder = write_run(tmp_path / "run", not_played="\x1b]0;owned\x07 a line\nand another")
    said = "nothing to show, the policy was not played: \\x1b]0;owned\\x07 a line and another"
    assert one_line(lambda: write_page(folder)) == f"{folder}/summary.json: {said}"


@pytest.mark.filterwarnings("error")
def test_numbers_that_cannot_be_drawn_are_told_in_a_line_alone(tmp_path):
    folder = write_run(tmp_path / "run", returns=[1e308, -1e308])
    message = one_line(lambda: write_page(folder))
    assert message.startswith(f"{folder}: no page can be made of it: ")
    assert "Warning" not in message


def flipped(data: bytearray, signature: bytes, offset: int, value: int) -> None:
    place = data.find(signature)
    while place >= 0:
        data[place + offset] = value
        place = data.find(signature, place + 1)


@pytest.mark.parametrize(
    ("offset", "value", "said"), [(6, 1, "encrypted"), (8, 99, "compression method")]
)
def test_an_archive_that_cannot_be_unpacked_is_told_in_a_line(tmp_path, offset, value, said):
    folder = write_run(tmp_path / "run")
    path = folder / "trajectories.npz"
    data = bytearray(path.read_bytes())
    # in the heads of the members and in the directory at the end
    flipped(data, b"PK\x03\x04", offset, value)
    flipped(data, b"PK\x01\x02", offset + 2, value)
    path.write_bytes(data)
    message = one_line(lambda: write_page(folder))
    assert message.startswith(f"{path}: damaged: ")
    assert said in message


def test_packed_bytes_that_are_damaged_are_told_in_a_line(tmp_path):
    folder = write_run(tmp_path / "run")
    path = folder / "trajectories.npz"
    data = bytearray(path.read_bytes())
    data[80:120] = bytes(byte ^ 255 for byte in data[80:120])
    path.write_bytes(data)
    assert one_line(lambda: write_page(folder)).startswith(f"{path}: damaged: ")


@pytest.mark.parametrize(
    ("kind", "shape", "size"),
    [
        ("<f4", "(100000000000,)", 64),
        ("<f4", "(-1,)", 64),
        ("<f4", "(" * 5000, 64),
        ("<f4", "(True,)", 64),
        ("<f4", f"(0, {10**22})", 0),
        ("|V0", f"({10**12},)", 0),
        ("<U0", f"({10**22},)", 0),
    ],
)
def test_no_room_is_made_for_an_array_larger_than_its_bytes(tmp_path, kind, shape, size):
    folder = write_run(tmp_path / "run")
    path = folder / "trajectories.npz"
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    head = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("fluents.npy", head + bytes(size))
    message = one_line(lambda: write_page(folder))
    assert message.startswith(f"{path}: damaged: ")
    assert "allocate" not in message


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("policy/reward", lambda old: np.float32(3)),
        ("policy/reward", lambda old: old[0]),
        ("policy/steps", lambda old: old.astype(str)),
        ("noop/state/level", lambda old: old[:, :2]),
        ("decision_seconds", lambda old: np.array(3)),
        ("decision_seconds", lambda old: -old),
        ("fluents", lambda old: np.array("[" * 100_000)),
        ("fluents", lambda old: np.array(str(old).replace("40", '"a"'))),
        ("fluents", lambda old: np.array(str(old).replace('"calm"', "1"))),
        ("fluents", lambda old: np.array(str(old).replace("calm", "m" * 1001))),
        ("fluents", lambda old: np.array(str(old).replace("t1", "t" * 1001))),
        ("fluents", lambda old: np.array(str(old).replace('"count"', '"\x1b[31m"'))),
    ],
)
def test_arrays_that_do_not_fit_are_told_in_a_line(tmp_path, name, change):
    folder = write_run(tmp_path / "run")
    path = folder / "trajectories.npz"
    with np.load(path) as file:
        arrays = dict(file)
    arrays[name] = change(arrays[name])
    np.savez(path, **arrays)
    assert one_line(lambda: write_page(folder)).startswith(f"{path}: damaged: ")


def test_more_steps_than_are_recorded_are_not_drawn(tmp_path):
    folder = tmp_path / "run"
    write_run(folder)
    steps = 501
    values = {(f.kind, f.name): np.zeros((1, steps, len(f.objects))) for f in FLUENTS}
    play = Trajectories(FLUENTS, np.arange(steps), values, np.zeros((1, steps)))
    write_play(folder, {"policy": play}, np.zeros(1))
    path = folder / "trajectories.npz"
    said = "'policy' has 501 steps, at most 500 are recorded"
    assert one_line(lambda: write_page(folder)) == f"{path}: damaged: {said}"


def test_whatever_else_goes_wrong_is_a_line_that_names_the_folder(tmp_path, monkeypatch):
    folder = write_run(tmp_path / "run")

    def fail(series: object) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr("mdpo_rddl.session.report.page.render.draw_panels", fail)
    message = one_line(lambda: write_page(folder))
    assert message == f"{folder}: no page can be made of it: MemoryError: no room"
