"""Own weights: one adaptation goes on as long as what it has found is the best."""

import dataclasses
import time

import numpy as np
import pytest
from helpers.lake_arenas import FOREVER, in_arena, lake_arena
from helpers.problems import assert_same_bits

from mdpo_rddl.auto.arms import own_weights
from mdpo_rddl.auto.arms.own_weights import Around, OwnWeightsArm
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.search.cma import Adaptation
from mdpo_rddl.auto.search.weights import weights_of
from mdpo_rddl.errors import Cancelled

GENERATIONS = 3
PARTS = ["shared", "own"]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    return lake_arena(tmp_path_factory.mktemp("lake"))


@pytest.fixture
def adaptations(monkeypatch):
    """All that are made, each of which has `GENERATIONS` in a slice."""
    made = []

    class Counted(Adaptation):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            made.append(self)

        def run(self, evaluate, until):
            ends = iter([0.0] * GENERATIONS)
            self._clock = lambda: next(ends, until)
            super().run(evaluate, until)

    monkeypatch.setattr(own_weights, "Adaptation", Counted)
    return made


def worked(arm, is_kept):
    """A slice; the judge keeps what it has found, or does not."""
    arm.work(1.0)
    (candidate,) = arm.take_candidates()
    judge = arm._arena.judge
    mean = judge.best_mean + (1.0 if is_kept else -1.0)
    judge.record(dataclasses.replace(candidate, mean=mean, error=0.0))


@pytest.fixture
def arm(compiled, adaptations):
    return OwnWeightsArm("polishing the weights", in_arena(compiled), Around(sigma=0.01))


def test_an_adaptation_goes_on_where_it_has_led(arm, adaptations):
    for _ in range(3):
        worked(arm, is_kept=True)
    (adaptation,) = adaptations
    assert adaptation.iterations == arm.log.iterations == 3 * GENERATIONS


def test_where_another_policy_is_better_for_long_another_adaptation_begins_there(arm, adaptations):
    worked(arm, is_kept=True)
    # one that has begun loses at first
    worked(arm, is_kept=False)
    worked(arm, is_kept=False)
    worked(arm, is_kept=False)
    assert [each.iterations for each in adaptations] == [3 * GENERATIONS, GENERATIONS]
    # with other samples
    first, second = (each._sampling.seed for each in adaptations)
    assert first != second


def with_net(arena):
    """The best policy so far, which has a net as well: none of the others has played one."""
    net = {
        name: part + 0.1 if "output" in name else part for name, part in arena.noop["net"].items()
    }
    candidate = arena.candidate("gradient", "phase 1", {**arena.noop, "net": net})
    judge = arena.judge
    judge.record(dataclasses.replace(candidate, mean=judge.best_mean + 1.0, error=0.0))


def test_around_a_net_a_program_is_compiled_of_which_the_slice_is_not_charged(arm, adaptations):
    arena = arm._arena
    worked(arm, is_kept=True)
    assert arena.population.is_compiled(weights_of(arena.noop, ["shared", "own"]))
    with_net(arena)
    around = weights_of(arena.incumbent.params, ["shared", "own"])
    assert not arena.population.is_compiled(around)
    began = arena.clock()
    end = arena.after_population_compiles(around, began + 1.0)
    assert arena.population.is_compiled(around)
    # it takes far longer than a tenth of a second
    assert end > began + 1.1
    assert arena.after_population_compiles(around, end) < end + 0.1
    worked(arm, is_kept=True)
    net = arm._arena.incumbent.params["net"]
    assert all(np.any(part) for name, part in net.items() if "output" in name)


def test_around_a_net_nothing_is_adapted_where_there_is_no_time_to_compile(compiled, adaptations):
    arena = in_arena(compiled)
    late = dataclasses.replace(arena, deadline=arena.clock() + 1.0)
    late.__dict__["population"] = Slow()
    with_net(late)
    with pytest.raises(TooLateError, match="no time to compile"):
        OwnWeightsArm("polishing the weights", late, Around(sigma=0.01)).work(1.0)
    assert adaptations == []


class Slow:
    """A population whose next program takes longer than there is."""

    population, compile_seconds = 32, 10.0

    def is_compiled(self, weights):
        return False

    def compile(self, weights):
        raise AssertionError("there is no time")


@pytest.fixture
def any_objects(monkeypatch):
    """The lake's pump is about no object, which is one."""
    monkeypatch.setattr(own_weights, "FEWEST_OBJECTS", 1)


@pytest.mark.usefixtures("any_objects")
def test_one_object_after_the_other_comes_first(compiled, monkeypatch):
    starts = []

    class Ended(Adaptation):
        def __init__(self, start, sampling, clock):
            super().__init__(start, sampling, lambda: np.inf)
            starts.append((start, sampling.sigma))

    monkeypatch.setattr(own_weights, "Adaptation", Ended)
    arm = OwnWeightsArm("own weights", in_arena(compiled), Around())
    arm.work(time.monotonic() + FOREVER)
    ((start, sigma),) = starts
    objects = own_weights.objects_of(arm._arena.planner.rddl, arm._arena.noop)
    assert np.any(start[objects == 0])
    assert not np.any(start[objects == -1])
    assert sigma == 0.01
    assert arm.log.iterations >= 2
    (candidate,) = arm.take_candidates()
    assert_same_bits(candidate.params, weights_of(arm._arena.noop, PARTS).to_params(start))
    # where that has led the adaptation goes on, without another such search
    mean = arm._arena.judge.best_mean + 1.0
    arm._arena.judge.record(dataclasses.replace(candidate, mean=mean, error=0.0))
    before = arm.log.iterations
    arm.work(time.monotonic() + FOREVER)
    assert (len(starts), arm.log.iterations) == (1, before)


def test_of_the_search_and_the_adaptation_the_better_one_is_handed_in(compiled, monkeypatch):
    def begins(arm, weights, seed, until):
        arm._begun = weights.start + 0.1

    monkeypatch.setattr(OwnWeightsArm, "_change_objects", begins)
    arm = OwnWeightsArm("own weights", in_arena(compiled), Around())
    weights = weights_of(arm._arena.noop, PARTS)
    asked = []

    def best(weights, vectors):
        asked.extend(vectors)
        return vectors[1]

    monkeypatch.setattr(arm._arena.population, "best", best)
    arm.work(time.monotonic() + 0.3)
    (candidate,) = arm.take_candidates()
    adapted, begun = asked
    np.testing.assert_array_equal(begun, weights.start + 0.1)
    assert np.any(adapted != begun)
    assert_same_bits(candidate.params, weights.to_params(begun))


@pytest.mark.usefixtures("any_objects")
def test_without_time_for_rounds_the_adaptation_comes_at_once(compiled, adaptations, monkeypatch):
    arm = OwnWeightsArm("own weights", in_arena(compiled), Around())
    monkeypatch.setattr(type(arm._arena.population), "seconds", 100.0)
    arm.work(time.monotonic() + 100.0)
    (adaptation,) = adaptations
    assert adaptation.iterations == arm.log.iterations == GENERATIONS
    (candidate,) = arm.take_candidates()
    mean = weights_of(arm._arena.noop, PARTS).to_params(adaptation.mean)
    assert_same_bits(candidate.params, mean)


@pytest.mark.usefixtures("any_objects")
def test_what_the_search_has_found_before_an_interruption_is_handed_in(compiled):
    pulses = iter(range(20))

    def pulse():
        if next(pulses, None) is None:
            raise Cancelled

    arm = OwnWeightsArm("own weights", in_arena(compiled, pulse), Around())
    with pytest.raises(Cancelled):
        arm.work(time.monotonic() + FOREVER)
    (candidate,) = arm.take_candidates()
    assert np.any(candidate.params["own"]["pump"]["bias"])
    assert not np.any(candidate.params["shared"]["pump"])
    assert arm.log.iterations == 20
