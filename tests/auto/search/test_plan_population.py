"""Plans side by side on the exact model: they restart, explore and find."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.probes import probed
from helpers.problems import write_corridor

from mdpo_rddl import evaluate, make_environment
from mdpo_rddl.auto.common import sizes
from mdpo_rddl.auto.common.gains import NoopReturn
from mdpo_rddl.planner.config.fitting import scaled, without_scales
from mdpo_rddl.auto.search import plan_population
from mdpo_rddl.auto.search.evolution import Evolved
from mdpo_rddl.auto.search.plan_population import PlanPopulation
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.exact.exact import visit_bytes
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.load import load_problem

NOOP_RETURN = NoopReturn(0.0, 0.0)


def plans_of(problem):
    config = auto_preset("toy").without_section("Search")
    seen = probed(build_planner(problem, without_scales(config)).planner, seed=0)
    planner = build_planner(problem, scaled(config, seen)).planner
    return seen, planner, planner.plan.initializer(np.zeros(2, np.uint32), {}, None)


@pytest.fixture(scope="module")
def corridor(tmp_path_factory):
    problem = write_corridor(tmp_path_factory.mktemp("corridor"))
    return problem, *plans_of(problem)


@pytest.mark.parametrize(("incumbent_return", "evolutions"), [(2.0, 3), (4.0, 1)])
def test_evolution_begins_again_where_it_has_converged(
    corridor, monkeypatch, incumbent_return, evolutions
):
    _, seen, planner, params = corridor
    starts, incumbents = [], []

    def converge(evaluate, start, breeding, goal):
        best = (3.0, 7.0, 5.0)[len(starts)]
        starts.append(float(np.abs(start).sum()))
        incumbents.append(goal.incumbent_return)
        return Evolved(np.full_like(start, best), best, 10, converged=len(starts) < 3)

    monkeypatch.setattr(plan_population, "evolve", converge)
    params = {**params, "plan": {name: part + 1.0 for name, part in params["plan"].items()}}
    plans = PlanPopulation(planner, seen, 0, Ticking())
    goal = plans.goal(1.0, NOOP_RETURN, incumbent_return, restarting=True)
    assert goal.until_converged
    result = plans.evolved(params, goal)
    assert starts[0] > 0.0
    assert starts[1:] == [0.0] * (evolutions - 1)
    assert incumbents == [incumbent_return] + [-np.inf] * (evolutions - 1)
    assert plans.iterations == 10 * evolutions
    best = 7.0 if evolutions > 1 else 3.0  # below the incumbent: not tried again
    assert all(np.all(np.asarray(part) == best) for part in result["plan"].values())


def test_a_hidden_prize_is_found(corridor):
    problem, seen, planner, params = corridor
    assert seen.deterministic
    assert seen.start_return <= seen.noop_return
    clock = Ticking()
    plans = PlanPopulation(planner, seen, 0, clock)
    archive = plans.archive(params)
    assert archive is not None
    goal = plans.goal(600.0, NOOP_RETURN, -np.inf, restarting=False)
    policy = playable(planner, plans.evolved(params, goal, archive), {}, 0)
    # each visit of the prize is worth 100
    assert evaluate(make_environment(problem), policy, episodes=1, seed=0).mean > 90.0
    assert len(archive) > 3
    assert clock.now < 700.0


def test_without_a_state_there_is_nothing_to_explore(tmp_path):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    domain.write_text(
        "domain bare { pvariables { push : { action-fluent, real, default = 0.0 }; };"
        " cpfs { }; reward = -pow[push, 2];"
        " action-preconditions { push >= -1.0; push <= 1.0; }; }"
    )
    instance.write_text(
        "non-fluents nf { domain = bare; } instance one { domain = bare; non-fluents = nf;"
        " max-nondef-actions = pos-inf; horizon = 5; discount = 1.0; }"
    )
    seen, planner, params = plans_of(load_problem(str(domain), str(instance)))
    assert PlanPopulation(planner, seen, 0, Ticking()).archive(params) is None


def test_states_that_are_too_many_are_not_kept_and_plans_are_played_all_the_same(
    corridor, monkeypatch
):
    _, seen, planner, params = corridor
    monkeypatch.setattr(sizes, "VISITS_BYTES", sizes.PLANS * visit_bytes(planner) - 1)
    plans = PlanPopulation(planner, seen, 0, Ticking())
    assert plans.archive(params) is None
    goal = plans.goal(12.0, NOOP_RETURN, -np.inf, restarting=False)
    plans.evolved(params, goal)
    assert plans.iterations > 0


def test_in_a_few_rollouts_a_plan_beats_a_random_no_op_by_more_than_luck(corridor):
    _, seen, planner, _ = corridor
    stochastic = PlanPopulation(planner, replace(seen, deterministic=False), 0, Ticking())
    noop = NoopReturn(-100.0, 20.0)
    assert stochastic.goal(1.0, noop, -np.inf, restarting=False).return_to_beat == -60.0
    lost = NoopReturn(-np.inf, 0.0)
    assert stochastic.goal(1.0, lost, -np.inf, restarting=False).return_to_beat == -np.inf
