"""Our planner and JaxPlan's in a run: trained within the time, kept, taken up again."""

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.toy_contest import tiny_instance

from mdpo_rddl.ipc.jaxplan import JaxPlanPlanner
from mdpo_rddl.ipc.mdpo import MDPO
from mdpo_rddl.ipc.planner import Restorable
from mdpo_rddl.ipc.registry import make_planner
from mdpo_rddl.ipc.trial import play
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.load import load_problem, make_environment

SECONDS = 2.5


@pytest.mark.parametrize("name", ["mdpo", "jaxplan-slp"])
def test_a_policy_is_trained_in_time_and_taken_up_bit_for_bit(tmp_path, monkeypatch, name):
    files = tiny_instance(tmp_path / "tiny")
    problem = load_problem(files.domain, files.instance)
    planner = make_planner(name)
    assert isinstance(planner, Restorable)
    asked, find = [], type(planner)._find

    def recorded(self, problem, seconds, seed):
        asked.append(seconds)
        return find(self, problem, seconds, seed)

    monkeypatch.setattr(type(planner), "_find", recorded)
    planner.prepare(problem, SECONDS, 0)
    # less a margin for what comes after
    assert asked == [0.85 * SECONDS]
    kept = tmp_path / "kept"
    kept.mkdir()
    planner.save(kept)
    again = make_planner(name)
    assert isinstance(again, Restorable)
    again.restore(problem, kept)
    results = []
    for each in (planner, again):
        rng = np.random.default_rng(0)
        results.append(play(make_environment(problem), each, 1, rng, lenient=False))
    (first, trace), (second, other) = results
    assert first == second
    assert first.status == "ok"
    np.testing.assert_array_equal(trace.arrays()["action/push"], other.arrays()["action/push"])


def test_jaxplan_has_its_own_configurations_where_it_ships_them():
    for method in ("slp", "drp"):
        planner = JaxPlanPlanner(method)
        known = load_problem("MarsRover_ippc2023", "1")
        unknown = load_problem("Wildfire_MDP_ippc2014", "1")
        assert planner.config(known) == jaxplan_config("MarsRover_ippc2023", method)
        assert planner.config(unknown) == jaxplan_config("default", method)
        assert type(planner._build(unknown, planner.config(unknown))) is JaxBackpropPlanner


def test_a_proven_optimum_is_kept_and_played_without_an_illegal_action(tmp_path):
    problem = toys.gambler(tmp_path, 5)
    planner, again = MDPO(), MDPO()
    planner.prepare(problem, 60.0, 0)
    kept = tmp_path / "kept"
    kept.mkdir()
    planner.save(kept)
    again.restore(problem, kept)
    assert isinstance(again._policy, TablePolicy)
    env, rng = make_environment(problem), np.random.default_rng(0)
    for seed in range(20):
        first, _ = play(env, planner, seed, rng, lenient=False)
        second, _ = play(env, again, seed, rng, lenient=False)
        assert first == second
        assert (first.status, first.violations) == ("ok", 0)


def test_ours_plays_a_legal_action_where_its_policys_is_not(tmp_path, monkeypatch):
    problem = load_problem("RecSim_ippc2023", "1")
    planner = MDPO()
    shape = np.shape(make_environment(problem).sampler.noop_actions["recommend"])
    greedy = {"recommend": np.ones(shape, bool)}

    class Greedy:
        """A policy that heeds no precondition."""

        def __init__(self, problem):
            self.problem = problem

        def __call__(self, step, state):
            return greedy

    monkeypatch.setattr(MDPO, "_find", lambda self, problem, *args: Greedy(problem))
    planner.prepare(problem, 1.0, 0)
    state, _ = make_environment(problem).reset(seed=0)
    actions = planner.act(0, state, np.random.default_rng(0))
    assert actions["recommend"].sum(axis=1).max() <= 1
