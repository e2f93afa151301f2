"""The search for open-loop plans: mutations, exploration, and what it finds."""

import time

import numpy as np
import pytest
from helpers.problems import write_corridor

from mdpo_rddl import evaluate, make_environment
from mdpo_rddl.auto.arms import plan_search
from mdpo_rddl.auto.arms.archive import Archive
from mdpo_rddl.auto.arms.evolution import Evolved, Goal, evolve
from mdpo_rddl.auto.arms.mutations import layout_of, mutants, random_values
from mdpo_rddl.auto.arms.plan_search import PlanSearch
from mdpo_rddl.auto.fitting import scaled, without_scales
from mdpo_rddl.auto.probing import probe
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.load import load_problem

HORIZON = 12
PLAN = {"push": np.zeros((HORIZON, 2, 3)), "on": np.zeros((HORIZON, 4))}
LAYOUT = layout_of(PLAN, ["on"])


def generator(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_layout_goes_there_and_back():
    assert LAYOUT.is_bool.tolist() == [False] * 6 + [True] * 4
    random = generator()
    plan = {name: random.normal(size=np.shape(part)) for name, part in PLAN.items()}
    vector = LAYOUT.vector(plan)
    assert vector.shape == (HORIZON, 10)
    for name, part in LAYOUT.tree(vector).items():
        np.testing.assert_allclose(part, plan[name], rtol=1e-6)
    assert LAYOUT.tree(vector[np.newaxis])["push"].shape == (1, HORIZON, 2, 3)


def test_mutants_differ_in_a_few_places_and_leave_their_parents_alone():
    parents = generator(1).uniform(-1.0, 1.0, (3, HORIZON, 10)).astype(np.float32)
    kept = parents.copy()
    children = mutants(parents, 200, LAYOUT, generator())
    np.testing.assert_array_equal(parents, kept)
    distance = np.abs(children[:, np.newaxis] - parents).sum(axis=(2, 3)).min(axis=1)
    assert np.count_nonzero(distance) > 150
    # most changes concern one action, not all ten
    touched = [
        min(np.count_nonzero((child != parent).any(axis=0)) for parent in parents)
        for child in children
    ]
    assert np.median(touched) <= 3
    assert max(touched) > 3


def test_values_of_bools_are_to_do_it_or_not():
    assert set(random_values(True, 50, generator())) == {-1.0, 1.0}
    numbers = random_values(False, 500, generator())
    assert np.max(np.abs(numbers)) == 1.0
    assert len(np.unique(numbers)) > 100


def test_an_archive_keeps_the_shortest_way_to_each_cell():
    archive = Archive(layout_of({"push": np.zeros((4, 1))}, []), {"x": (0.0, 1.0)}, seed=0)
    slow, fast = np.full((4, 1), 0.25), np.full((4, 1), 0.5)
    plans = np.stack([slow, fast]).astype(np.float32)
    archive.add(plans, {"x": np.cumsum(plans, axis=1)[:, :, 0]})
    # cells are half a scale wide: [0.0, 0.5), ..., [2.0, 2.5)
    assert len(archive) == 5
    # two steps of 0.25 lead into the second cell, and one of 0.5
    prefixes = {float(np.sum(plan[:step])): step for plan, step in archive._prefixes}
    assert prefixes == {0.25: 1, 0.5: 1, 1.0: 2, 1.5: 3, 2.0: 4}
    made = archive.plans(20)
    assert made.shape == (20, 4, 1)
    again = Archive(layout_of({"push": np.zeros((4, 1))}, []), {"x": (0.0, 1.0)}, seed=0)
    again.add(plans, {"x": np.cumsum(plans, axis=1)[:, :, 0]})
    np.testing.assert_array_equal(again.plans(20), made)


def test_evolution_finds_the_best_plan_of_a_bowl():
    target = generator(3).uniform(-0.8, 0.8, (HORIZON, 10))
    target[:, LAYOUT.is_bool] = np.sign(target[:, LAYOUT.is_bool])

    def evaluate(iteration, plans):
        return -np.sum((plans - target) ** 2, axis=(1, 2)), dict

    result = evolve(
        evaluate,
        np.zeros((1, HORIZON, 10), np.float32),
        LAYOUT,
        Goal(until=time.monotonic() + 5.0, bar=-np.inf),
        population=64,
        begin=0,
        archive=None,
        random=generator(),
    )
    assert -evaluate(0, result.elites[:1])[0][0] < 0.4 * np.sum(target**2)


@pytest.mark.parametrize(("rival", "most"), [(1e9, 0.6), (-np.inf, 60.0)])
def test_evolution_gives_up_where_it_would_not_catch_up(rival, most):
    begun = time.monotonic()
    seconds = 15.0 if np.isfinite(rival) else 0.3

    def evaluate(iteration, plans):
        time.sleep(0.01)
        return -np.sum(plans**2, axis=(1, 2)), dict

    evolve(
        evaluate,
        np.ones((1, HORIZON, 10), np.float32),
        LAYOUT,
        Goal(until=begun + seconds, bar=-np.inf, rival=rival),
        population=16,
        begin=0,
        archive=None,
        random=generator(),
    )
    taken = time.monotonic() - begun
    assert taken < most * seconds
    assert taken > 0.2 * seconds


@pytest.mark.parametrize("until_settled", [False, True])
def test_evolution_ends_where_nothing_more_is_gained_if_it_shall(until_settled):
    def evaluate(iteration, plans):
        # as much as there is to gain is gained at once
        return np.where(np.any(plans != 0.0, axis=(1, 2)), 5.0, 0.0), dict

    begun = time.monotonic()
    result = evolve(
        evaluate,
        np.zeros((1, HORIZON, 10), np.float32),
        LAYOUT,
        Goal(
            until=begun + (60.0 if until_settled else 1.0), bar=-np.inf, until_settled=until_settled
        ),
        population=16,
        begin=0,
        archive=None,
        random=generator(),
    )
    assert result.settled is until_settled
    assert result.best == 5.0
    if until_settled:
        assert result.iterations < 300


@pytest.mark.parametrize(("rival", "searches"), [(2.0, 3), (4.0, 1)])
def test_a_search_begins_again_where_it_has_settled(tmp_path, monkeypatch, rival, searches):
    found, planner, params = plans_of(write_corridor(tmp_path))
    starts, rivals = [], []

    def settle(evaluate, start, layout, goal, **kwargs):
        earned = (3.0, 7.0, 5.0)[len(starts)]
        starts.append(float(np.abs(start).sum()))
        rivals.append(goal.rival)
        elites = np.full_like(start, earned)
        return Evolved(elites, earned, iterations=10, settled=len(starts) < 3)

    monkeypatch.setattr(plan_search, "evolve", settle)
    params = {**params, "plan": {name: part + 1.0 for name, part in params["plan"].items()}}
    search = PlanSearch(planner, found, seed=0)
    result = search.search(params, until=time.monotonic(), rival=rival, restarting=True)
    assert starts[0] > 0.0
    assert starts[1:] == [0.0] * (searches - 1)
    assert rivals == [rival] + [-np.inf] * (searches - 1)
    assert search.iterations == 10 * searches
    best = 7.0 if searches > 1 else 3.0  # no match for the rival: not tried again
    assert all(np.all(np.asarray(part) == best) for part in result["plan"].values())


def plans_of(problem):
    config = auto_preset("toy").without_section("Search")
    found = probe(build_planner(problem, without_scales(config)).planner, seed=0)
    planner = build_planner(problem, scaled(config, found)).planner
    return found, planner, planner.plan.initializer(np.zeros(2, np.uint32), {}, None)


def test_a_hidden_prize_is_found(tmp_path):
    problem = write_corridor(tmp_path)
    found, planner, params = plans_of(problem)
    assert found.deterministic
    assert found.start_return <= found.nothing
    search = PlanSearch(planner, found, seed=0)
    earned, slices = 0.0, 0
    while earned <= 90.0 and slices < 20:  # however slow the machine
        params = search.search(params, until=time.monotonic() + 4.0, exploring=True)
        policy = playable(planner, params, {}, 0)
        # each visit of the prize is worth 100
        earned = evaluate(make_environment(problem), policy, episodes=1, seed=0).mean
        slices += 1
    assert earned > 90.0


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
    found, planner, params = plans_of(load_problem(str(domain), str(instance)))
    search = PlanSearch(planner, found, seed=0)
    search.search(params, until=time.monotonic() + 1.0, exploring=True)
    assert search.iterations > 0
