"""What an arm has found before it is interrupted in a slice is handed in."""

import time

import numpy as np
import pytest
from helpers.lake_arenas import FOREVER, in_arena, lake_arena, shared

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.exploration import ExplorationArm
from mdpo_rddl.auto.arms.own_weights import Around, OwnWeightsArm
from mdpo_rddl.auto.arms.plan_search import Evolving, PlanArm
from mdpo_rddl.auto.search import plan_population
from mdpo_rddl.auto.search.weights import flat_vector
from mdpo_rddl.errors import Cancelled


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    return lake_arena(tmp_path_factory.mktemp("lake"))


def polishing(arena: Arena) -> OwnWeightsArm:
    return OwnWeightsArm("own weights", arena, Around())


def evolving(arena: Arena) -> PlanArm:
    return PlanArm("plan", arena, Evolving())


@pytest.mark.parametrize("pulses", [0, 5])
@pytest.mark.parametrize("make", [shared, polishing, evolving, ExplorationArm])
def test_what_was_found_before_an_interruption_is_handed_in(compiled, make, pulses, monkeypatch):
    # or the exploration ends at once
    monkeypatch.setattr(plan_population, "return_to_beat_by_luck", lambda noop, rollouts: np.inf)
    left, elites = iter(range(pulses)), []

    def pulse() -> None:
        if next(left, None) is None:
            elites.append(arena.plans.elites)
            raise Cancelled

    arena = in_arena(compiled, pulse)
    arm = make(arena)
    with pytest.raises(Cancelled):
        arm.work(time.monotonic() + FOREVER)
    found = arm.take_candidates()
    is_evolved = make in (evolving, ExplorationArm)
    # plans call it after an iteration, adaptations before
    assert len(found) == (pulses > 0 or is_evolved)
    if not found:
        return
    params = found[0].params
    assert not np.array_equal(flat_vector(params), flat_vector(arena.noop))
    if is_evolved:
        np.testing.assert_array_equal(arena.plans.plan_of(params), elites[0][0])
