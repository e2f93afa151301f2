"""The paper's settings: the shipped files, found by their names."""

from helpers.mistakes import one_line

from benchmarks.common.auto_variants import VARIANTS
from benchmarks.common.names import SETTINGS
from benchmarks.common.settings import load_setting
from benchmarks.common.table1 import TABLE
from benchmarks.presets.names import VARIANT_NAMES


def test_every_setting_loads_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert set(SETTINGS) == {setting for setting, _ in TABLE}
    for name in SETTINGS:
        problem = load_setting(name)
        assert (problem.label, problem.horizon) == (name, 120)


def test_an_unknown_setting_names_the_known_ones():
    message = one_line(lambda: load_setting("powergen8"))
    assert message == f"unknown setting 'powergen8', known are {', '.join(SETTINGS)}"


def test_the_command_offers_the_variants_that_there_are():
    assert tuple(VARIANTS) == VARIANT_NAMES
