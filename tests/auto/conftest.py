"""Problems that compile fast, and races whose programs are compiled once."""

from dataclasses import replace

import pytest
from helpers.hidden_races import told_races
from helpers.lakes import preset, write_lake
from helpers.problems import write_corridor
from helpers.races import CLOCK

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms import gradient
from mdpo_rddl.auto.race import affording, race
from mdpo_rddl.errors import InputError

KEPT = "the best policy so far is kept: "


@pytest.fixture
def failing_race():
    """For a test in which the race itself, and not an arm, is to fail."""


@pytest.fixture(autouse=True)
def _no_failing_race(request, caplog):
    """A race that ends with its incumbent must not hide why."""
    yield
    if "failing_race" not in request.fixturenames:
        told = [record.getMessage() for record in caplog.get_records("call")]
        assert [line for line in told if line.startswith(KEPT)] == []


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    return write_lake(tmp_path_factory.mktemp("lake"))


@pytest.fixture(scope="module")
def corridor(tmp_path_factory):
    return write_corridor(tmp_path_factory.mktemp("corridor"))


@pytest.fixture
def no_gradient(monkeypatch):
    def refuse_to_compile(training):
        raise InputError("this model has no gradient")

    monkeypatch.setattr(gradient.Training, "compile", refuse_to_compile)


@pytest.fixture
def one_core(monkeypatch):
    """Compilations are waited for: the clock of the tests does not move meanwhile."""
    monkeypatch.setattr(affording, "usable_cores", lambda: 1)


@pytest.fixture(scope="module")
def compiled(lake):
    """An arena whose programs are compiled once for all tests that look at the order of arms."""
    options = RaceOptions(clock=CLOCK, most_iterations=60)
    return race._arena(lake, preset(1000.0), 0, CLOCK(), options)


@pytest.fixture
def in_one_arena(compiled, monkeypatch):
    def as_new(problem, config, seed, began, options):
        judge = Judge(128, seed, CLOCK, began)
        judge._players = compiled.judge._players
        deadline = began + config.section("Optimize")["train_seconds"]
        times = {"deadline": deadline, "began": began}
        told = {"on_progress": options.on_progress, "pulse": options.on_pulse}
        arena = replace(compiled, judge=judge, **times, **told)
        arena.__dict__.update(population=compiled.population, plans=compiled.plans)
        return arena

    monkeypatch.setattr(race, "_arena", as_new)


@pytest.fixture
def raced(monkeypatch):
    """Plans where the state is hidden, with races that give what they are told to."""
    return told_races(monkeypatch)
