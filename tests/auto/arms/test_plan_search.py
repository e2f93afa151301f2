"""The arm that evolves plans."""

from dataclasses import replace

import pytest
from helpers.clocks import Stopped
from helpers.lake_arenas import in_arena, lake_arena

from mdpo_rddl.auto.arms.plan_search import Evolving, PlanArm
from mdpo_rddl.auto.search.by_parts import ByParts
from mdpo_rddl.auto.search.plan_population import PlanPopulation


@pytest.mark.parametrize(("seconds", "deadline", "end"), [(50.0, 1e3, 60.0), (50.0, 40.0, 40.0)])
def test_a_slice_has_its_time_beside_the_compilation(tmp_path, monkeypatch, seconds, deadline, end):
    clock, ends = Stopped(), []
    arena = replace(in_arena(lake_arena(tmp_path)), clock=clock, deadline=deadline)

    def compile_slowly(plans, params):
        clock.now += seconds

    def evolved(plans, params, goal):
        ends.append(goal.until)
        return params

    monkeypatch.setattr(PlanPopulation, "compile", compile_slowly)
    monkeypatch.setattr(PlanPopulation, "evolved", evolved)
    PlanArm("plan", arena, Evolving()).work(10.0)
    assert ends == [end]


def test_a_program_is_compiled_once(tmp_path, monkeypatch):
    arena = in_arena(lake_arena(tmp_path))
    arena.plans.compile(arena.noop)
    assert arena.plans.is_compiled
    monkeypatch.setattr(ByParts, "__call__", lambda *arguments: pytest.fail("it is played again"))
    arena.plans.compile(arena.noop)
    assert arena.plans.iterations == 0
