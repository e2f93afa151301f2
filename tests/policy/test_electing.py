"""What is played in a belief: what is worth most on average, or what most particles would play."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from helpers.tiger import NOTHING_SHOWN, listener
from helpers.toys import problem_from, toy
from helpers.umbrella import careless, pattering

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.fitting import greedy
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy import electing
from mdpo_rddl.policy.electing import compiled_election, elected
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.problem.underlying import underlying_mdp

KEY = jax.random.PRNGKey(0)
GREEDY = greedy(auto_preset("").without_section("Search"))
# behind each of two doors there may be a prize; one that is locked cannot be opened
DOORS = """
domain doors {
    requirements = { partially-observed };
    types { door : object; };
    pvariables {
        prize(door) : { state-fluent, bool, default = false };
        locked(door) : { state-fluent, bool, default = false };
        drawn : { state-fluent, bool, default = false };
        seen(door) : { observ-fluent, bool };
        open(door) : { action-fluent, bool, default = false };
    };
    cpfs {
        prize'(?d) = if (drawn) then prize(?d) else Bernoulli(0.5);
        locked'(?d) = if (drawn) then locked(?d) else Bernoulli(0.5);
        drawn' = true;
        seen(?d) = prize'(?d);
    };
    reward = sum_{?d : door} [open(?d) * (if (prize(?d)) then 2.0 else -1.0)];
    action-preconditions { forall_{?d : door} [open(?d) => ~locked(?d)]; };
}
non-fluents nf { domain = doors; objects { door : {a, b}; }; }
instance one {
    domain = doors; non-fluents = nf; max-nondef-actions = 1; horizon = 4; discount = 1.0;
}
"""


@functools.cache
def optimum(keeps_values: bool):
    problem = underlying_mdp(toy("tiger"))
    return find_optimum(problem, 60.0, keeps_values=keeps_values).policy()


@functools.cache
def greedy_one() -> Policy:
    """Of the tiger's underlying MDP, greedy for the reward of one step."""
    problem = underlying_mdp(toy("tiger"))
    planner = build_planner(problem, GREEDY).planner
    return Policy(
        problem,
        GREEDY,
        planner.plan.initializer(KEY, {}, None),
        {},
        seed=0,
        compiled=Compiled(planner),
    )


def opened(underlying, growls):
    """What a player opens after so many growls from the left: "left", "right" or nothing."""
    saved = underlying.to_saved()
    policy = dataclasses.replace(listener(), saved_underlying=saved, votes=True)
    action = policy(0, NOTHING_SHOWN)
    # what is played at first draws where the tiger is
    for step in range(growls):
        action = policy(1 + step, {"growl-left": np.bool_(True)})
        policy.was_played({name: np.bool_(False) for name in action})
    return next((name for name in ("left", "right") if bool(action[f"open-{name}"])), None)


def test_an_unlikely_large_loss_outweighs_a_likely_gain():
    # 85% of the particles would open the other door, at 10 for them and -100 for the others
    assert opened(optimum(keeps_values=False), 1) == "right"
    for underlying in (optimum(keeps_values=True), greedy_one()):
        assert opened(underlying, 1) is None
        assert opened(underlying, 3) == "right"


def test_of_many_actions_those_are_tried_that_are_voted_for(monkeypatch):
    monkeypatch.setattr(electing, "_MOST_ACTIONS", 2)
    assert opened(optimum(keeps_values=True), 1) is None
    assert opened(optimum(keeps_values=True), 3) == "right"


def at_the_doors(text):
    """What chooses between them, for the prizes and locks of particles [P, 2] each."""
    problem = problem_from(text)
    planner = build_planner(problem, careless().config).planner
    table = find_optimum(underlying_mdp(problem), 60.0, keeps_values=True).policy()
    elect = compiled_election(planner, table)

    def chosen(prizes, locked):
        drawn = jnp.ones(len(prizes), bool)
        state = {"prize": jnp.array(prizes), "locked": jnp.array(locked), "drawn": drawn}
        return np.asarray(elect(KEY, 1, state)["open"]).tolist()

    return chosen


ONE_IS_OPENED = "(sum_{?d : door} [open(?d)]) == 1"
BOTH, FIRST, NEITHER = [True, True], [True, False], [False, False]


def test_an_illegal_action_is_worth_what_the_no_op_is():
    chosen = at_the_doors(DOORS)
    assert chosen([FIRST] * 3, [NEITHER] * 3) == [True, False]
    assert chosen([BOTH] * 3, [FIRST] * 3) == [False, True]
    assert chosen([FIRST] * 3, [FIRST] * 3) == [False, False]
    # legal for one of three it gains there, and elsewhere loses nothing
    assert chosen([FIRST] * 3, [FIRST, FIRST, NEITHER]) == [True, False]


def test_a_no_op_that_is_illegal_is_not_played_however_much_it_would_pay():
    unlocked = DOORS.replace("forall_{?d : door} [open(?d) => ~locked(?d)]", ONE_IS_OPENED)
    assert ONE_IS_OPENED in unlocked
    bonus = "reward = 9.0 * (~exists_{?d : door} [open(?d)]) +"
    chosen = at_the_doors(unlocked.replace("reward =", bonus))
    assert chosen([FIRST] * 3, [NEITHER] * 3) == [True, False]
    assert sum(chosen([NEITHER] * 3, [NEITHER] * 3)) == 1


def test_the_action_with_the_most_votes_is_elected():
    votes = jnp.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0], [0.0, 0.0], [0.0, 1.0]])
    assert int(elected(votes, is_joint=True)) in (2, 3, 5)
    # not what is nearest to all, which may be what no one wants
    between = jnp.array([[1.0, 0.0]] * 4 + [[0.0, 1.0]] * 3 + [[0.0, 0.0]] * 2)
    assert int(elected(between, is_joint=True)) < 4


def test_else_the_action_nearest_to_the_median_of_each_component():
    rest = [[1.0, 0.0, 5.0], [1.0, 1.0, 6.0], [0.0, 1.0, 90.0]]
    votes = jnp.array([*rest, [1.0, 1.0, 5.5], [0.0, 0.0, 5.2]])
    assert int(elected(votes, is_joint=False)) == 3
    # a component in which all agree says nothing
    assert int(elected(jnp.array([[2.0, 3.0], [2.0, 4.0], [2.0, 9.0]]), is_joint=False)) == 1


def test_a_rule_of_the_underlying_mdp_votes_too():
    problem = underlying_mdp(toy("umbrella"))
    config = careless().config
    planner = build_planner(problem, config).planner
    params = jax.tree.map(np.zeros_like, planner.plan.initializer(jax.random.PRNGKey(0), {}, None))
    biases = {name: {**own, "bias": np.float32(4.0)} for name, own in params["own"].items()}
    always = Policy(
        problem, config, {**params, "own": biases}, {}, seed=0, compiled=Compiled(planner)
    )
    policy = dataclasses.replace(careless(), saved_underlying=always.to_saved(), votes=True)
    assert bool(policy(0, {"patter": np.array(None)})["take"])
    assert bool(policy(1, pattering(False))["take"])


FUSE = """domain fuse {
    requirements = { partially-observed };
    pvariables {
        hot : { state-fluent, bool, default = false };
        gauge : { interm-fluent, bool };
        smell : { observ-fluent, bool };
        go : { action-fluent, bool, default = false };
    };
    cpfs {
        hot' = Bernoulli(0.5);
        gauge = Bernoulli(if (hot ^ go) then 2.0 else 0.5);
        smell = if (hot') then Bernoulli(0.9) else Bernoulli(0.1);
    };
    reward = go;
}
non-fluents nf { domain = fuse; }
instance one {
    domain = fuse; non-fluents = nf; max-nondef-actions = 1; horizon = 6; discount = 1.0;
}
"""
