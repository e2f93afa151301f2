"""Plans by evolution: how they are written, changed, played, and offered."""

import functools
import importlib

import numpy as np
import pytest

from mdpo_rddl.planner.config.fitting import scaled
from mdpo_rddl.planner.config.presets import auto_preset
from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.race.arm import Candidate, Context, Judged, Turn
from mdpo_rddl.race.arms.plan_archive import Archive
from mdpo_rddl.race.arms.plan_mutations import (
    BOOL,
    CHOICE,
    INTEGER,
    KINDS,
    REAL,
    Genes,
    Limit,
    Parents,
    children,
    genes_of,
    random_plans,
)
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.evaluator import Evaluator, worth
from mdpo_rddl.race.family import Family
from mdpo_rddl.race.probe import probe
from mdpo_rddl.simulator.simulator import Simulator

arm = importlib.import_module("mdpo_rddl.race.arms.plans")


def _nothing():
    pass


def context_of(domain, instance, seed=1):
    problem = load_problem(domain, instance)
    simulator = Simulator(problem)
    seen = probe(problem, simulator, seed)
    config = scaled(auto_preset(problem).without_section("Search"), seen)
    family = Family(problem, simulator, config, seed, _nothing)
    # its clock stands still: a turn until then is one iteration
    budget = Budget(0.0, 1.0, lambda: 0.0)
    evaluator = Evaluator(simulator, seed)
    certain = seen.is_certain
    return Context(problem, simulator, evaluator, budget, seed, family, certain, _nothing)


@pytest.fixture(scope="module")
def certain():
    """Objects as actions, no chance, a reward."""
    return context_of("Sokoban_arcade", "0")


@pytest.fixture(scope="module")
def uncertain():
    """Reals and bools without a box, and chance."""
    return context_of("Zombies_arcade", "0")


def turn_of(context, params=None):
    policy = context.family.policy(params or context.family.noop)
    return Turn(0.0, Judged(Candidate("constants", "no-op", policy), np.zeros(1)), None)


def genes_by_hand(limits=(), horizon=2):
    kind = np.array([BOOL, BOOL, BOOL, REAL, INTEGER])
    lower, upper = np.array([0.0, 0, 0, -1, -0.5]), np.array([1.0, 1, 1, np.inf, 0.5])
    places = {"b": slice(0, 3), "r": slice(3, 4), "i": slice(4, 5)}
    unit = np.array([1.0, 1, 1, 2, 4])
    shapes = {"b": (3,), "r": (), "i": ()}
    part = np.array([0, 1, 2, 3, 3])
    return Genes(horizon, places, shapes, kind, unit, lower, upper, part, limits)


def test_raw_numbers_come_into_their_box_and_to_whole_numbers():
    plans = np.array([0.4, 0.6, 3.0, -2.0, 0.3], np.float32)[np.newaxis, :, np.newaxis]
    found = genes_by_hand(horizon=1).tidied(plans)[0, :, 0]
    # an integer whose unit is 4 is at 1.2, so at 1
    np.testing.assert_array_equal(found, [0.0, 1.0, 1.0, -1.0, 0.25])


def test_what_was_changed_last_stays_within_a_limit():
    group = np.array([0, 0, 0, -1, -1])
    limit = Limit(group, np.array([1]), False, np.zeros(5, bool))
    old = np.zeros((2, 5, 1), np.float32)
    old[:, 0] = 1.0
    new = old.copy()
    new[1, 2] = 1.0
    found = genes_by_hand([limit]).tidied(new, old, np.random.default_rng(0))
    np.testing.assert_array_equal(found[:, :3, 0], [[1, 0, 0], [0, 0, 1]])


def test_an_exact_limit_makes_some_other_true():
    group = np.array([0, 0, 0, -1, -1])
    limit = Limit(group, np.array([2]), True, np.array([True, False, False, False, False]))
    plans = np.zeros((2, 5, 7), np.float32)
    plans[:, 0] = 1.0  # which is false then
    found = genes_by_hand([limit]).tidied(plans, 0.0, np.random.default_rng(0))
    is_true = (found[:, :3] != 0) ^ np.array([True, False, False])[:, np.newaxis]
    assert np.all(is_true.sum(axis=1) == 2)


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=KINDS)
def test_a_change_is_late_enough_and_within_the_box(kind):
    genes = genes_by_hand(horizon=12)
    random = np.random.default_rng(kind)
    parents = random_plans(genes, 4, random)
    gains = parents[..., :2] - parents[..., 2:]
    found, parent = children(genes, Parents(parents, gains, 5), np.full(64, kind), random)
    np.testing.assert_array_equal(found[:5], parents[:5][..., parent])
    assert np.any(found != parents[..., parent])
    np.testing.assert_array_equal(found, genes.tidied(found.copy()))


def test_trees_and_flat_plans_are_each_others_inverse():
    genes = genes_by_hand(horizon=3)
    plans = random_plans(genes, 4, np.random.default_rng(0))
    np.testing.assert_array_equal(genes.flat(genes.tree(plans)), plans)


def test_objects_are_whole_numbers_within_their_type(certain):
    genes = genes_of(certain.simulator, certain.family)
    assert set(genes.kind) == {CHOICE}
    plans = random_plans(genes, 50, np.random.default_rng(0))
    played = certain.simulator.noop["move"] + genes.unit[:, np.newaxis] * plans
    assert set(np.unique(played.round(5))) == {0, 1, 2, 3, 4}


def test_a_plan_returns_what_its_policy_does(uncertain):
    genes = genes_of(uncertain.simulator, uncertain.family)
    plans = random_plans(genes, 3, np.random.default_rng(0))
    played = arm.play(uncertain, genes, plans, [5], 64)
    for number, mean in enumerate(played.returns):
        tree = {**uncertain.family.noop, "plan": genes.tree(plans[..., number])}
        policy = uncertain.family.policy(tree).replicated()
        found = worth(uncertain.simulator, policy, 256, 3, _nothing)
        error = np.std(found) * np.sqrt(1 / 64 + 1 / 256)
        assert abs(found.mean() - mean) < 4 * error + 1e-6


def test_plans_meet_the_same_numbers(uncertain):
    genes = genes_of(uncertain.simulator, uncertain.family)
    plans = np.repeat(random_plans(genes, 1, np.random.default_rng(0)), 3, axis=-1)
    assert np.ptp(arm.play(uncertain, genes, plans, [5], 4).returns) == 0.0


def test_going_on_from_a_step_is_playing_from_the_first(certain):
    genes = genes_of(certain.simulator, certain.family)
    plans = random_plans(genes, 20, np.random.default_rng(0))
    marks = frozenset([0, 3, 7])
    whole = arm.play(certain, genes, plans, [1], 1, arm.Start(marks=marks))
    rest = arm.play(certain, genes, plans, [2], 1, arm.Start(3, whole.points[3], marks))
    np.testing.assert_array_equal(rest.returns, whole.returns)
    for name, value in whole.points[7].state.items():
        np.testing.assert_array_equal(rest.points[7].state[name], value)


def test_the_archive_knows_ways_to_its_cells(certain):
    simulator, genes = certain.simulator, genes_of(certain.simulator, certain.family)
    seen = [simulator.initial(4)]
    draw = functools.partial(random_plans, genes)
    archive = Archive(simulator, len(genes.kind), arm.acting(certain, genes), draw, seen)
    random = np.random.default_rng(0)
    for _ in range(4):
        found = archive.explore(32, random)
    assert found.shape[:2] == (genes.horizon, len(genes.kind))
    assert len(archive) > 20
    none = np.zeros((0, len(genes.kind)), np.float32)
    plans = np.stack([archive._plan(n, none) for n in range(len(archive))], axis=-1)
    steps = archive._steps.values[: len(archive)].astype(int)
    assert np.all((steps <= genes.horizon) & (steps[1:].min() > 0))
    marks = frozenset(range(genes.horizon))
    points = arm.play(certain, genes, plans, [1], 1, arm.Start(marks=marks)).points
    for number, step in enumerate(steps):
        if step < genes.horizon:
            point = points[int(step)]
            assert point.total[number] == pytest.approx(archive._totals.values[number])
            for name, rows in archive._states.items():
                np.testing.assert_array_equal(point.state[name][..., number], rows.values[number])


def test_without_chance_the_claim_is_what_the_policy_returns(certain):
    assert certain.certain
    search, turn = arm.plans(), turn_of(certain)
    state = first = search.init(certain)
    claims = []
    for number in range(12):
        state = search.step(certain, state, turn)
        claims.append(state.claim)
        assert state.iterations == number + 1
        if state.found:
            policy = state.found[-1].policy
    assert claims == sorted(claims)
    assert claims[-1] > state.noop
    found = worth(certain.simulator, policy.replicated(), 1, 0, _nothing)
    assert found[0] == state.claim
    # the first state is as it was
    assert first.elites is None
    assert first.iterations == 0


def test_the_same_seed_is_the_same_search(uncertain):
    search, turn = arm.plans(), turn_of(uncertain)
    both = [search.init(uncertain) for _ in range(2)]
    for _ in range(3):
        both = [search.step(uncertain, state, turn) for state in both]
    one, two = both
    np.testing.assert_array_equal(one.best.plans, two.best.plans)
    assert one.claim == two.claim


def test_what_the_leader_plays_is_among_the_first_plans(certain):
    plan = np.zeros((certain.problem.horizon, *certain.simulator.shapes["move"]), np.float32)
    plan[::2] = 0.25
    params = {**certain.family.noop, "plan": {"move": plan}}
    state = arm.plans().init(certain)
    found, plans = arm._recorded(certain, state, turn_of(certain, params).leader.candidate)
    raw = certain.simulator.noop["move"] + 4 * plans[:, 0, 0]
    wanted = np.clip(certain.simulator.noop["move"] + 4 * plan, 0, 4)
    np.testing.assert_array_equal(raw, wanted.round())
    # once
    assert arm._recorded(certain, found, found.leader)[1].shape[-1] == 0


def test_an_evolution_is_stale_when_it_gains_nothing_for_as_long_as_it_had_taken():
    run = arm.Run(10, 10, 0.0, 0.0).after(50, 100.0)
    assert run.gained == 50
    # less than a hundredth of all that was gained
    assert run.after(80, 100.5).gained == 50
    assert not run.is_stale(90)
    assert run.is_stale(91)
    assert not arm.Run(10, 10, 0.0, 0.0).is_stale(30)
