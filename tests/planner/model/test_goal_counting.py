"""The reward with goals counted: what counts as one, and for how much."""

import jax
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import toy

from mdpo_rddl.auto.probing.fitting import without_scales
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.model.goal_counting import counted_reward

ALL = "forall_{?l : lock} [open(?l)]"
NONE = "forall_{?l : lock} [~open(?l)]"
LOCKS = 7


def rewards_of(goal: str, termination: str = "", first: str = "open(l1) = false;"):
    """A function of which locks are open that gives the reward with goals counted, or None."""
    words = {"GOAL": f"({goal})", "TERMINATION": termination, "FIRST": first}
    planner = build_planner(toy("locks", **words), without_scales(preset(1.0))).planner
    exact = planner.test_compiled
    counted = counted_reward(exact)
    if counted is None:
        return None
    fluents, nonfluents = exact.split_fluent_nonfluent(exact.init_values)

    def reward(*is_open: int) -> float:
        given = {**fluents, "open": np.isin(np.arange(1, LOCKS + 1), is_open)}
        key = jax.random.PRNGKey(0)
        return float(counted(given, nonfluents, exact.model_aux["params"], key))

    return reward


@pytest.mark.parametrize(
    "goal",
    [
        ALL,
        "~exists_{?l : lock} [~open(?l)]",
        f"~~({ALL})",
        f"if ({ALL}) then 1 else 0",
        "1 - (if (exists_{?l : lock} [~open(?l)]) then 1 else 0)",
        f"({ALL}) ^ ({ALL})",
        f"({ALL}) | false",
        f"true => ({ALL})",
    ],
)
def test_each_condition_of_a_goal_counts(goal):
    reward = rewards_of(goal)
    assert [reward(*range(1, 1 + count)) for count in (0, 1, 3, LOCKS)] == pytest.approx(
        [0.0, 10.0 / 7.0, 30.0 / 7.0, 10.0]
    )


def test_what_holds_at_first_does_not_count():
    reward = rewards_of(ALL, first="open(l1); open(l2);")
    assert [reward(1, 2), reward(1, 2, 3), reward(1)] == pytest.approx([0.0, 2.0, -2.0])


def test_of_two_goals_the_mean_counts_and_of_either_the_largest():
    last = "forall_{?l : lock} [LAST(?l) => open(?l)]"
    assert rewards_of(f"({ALL}) ^ ({last})")(LOCKS) == pytest.approx(10.0 * (1.0 / 7.0 + 1.0) / 2.0)
    assert rewards_of(f"({ALL}) | ({last})")(LOCKS) == pytest.approx(10.0)


def test_what_a_policy_chooses_must_hold():
    chosen = f"({ALL}) ^ ~(exists_{{?l : lock}} [turn(?l)])"
    reward, turned = rewards_of(chosen), rewards_of(chosen.replace("~", ""))
    twice = rewards_of(f"({chosen}) ^ ~(exists_{{?l : lock}} [turn(?l)])")
    assert [reward(1), turned(1), twice(1)] == pytest.approx([10.0 / 7.0, 0.0, 10.0 / 7.0])


def test_a_long_choice_is_compiled_once():
    choice = f"if ({ALL}) then 1 else 0"
    for _ in range(40):
        choice = f"if (exists_{{?l : lock}} [turn(?l)]) then 2 else ({choice})"
    assert rewards_of(choice)(1) == pytest.approx(10.0 / 7.0)


@pytest.mark.parametrize(
    "goal",
    [
        NONE,  # holds already
        "exists_{?l : lock} [open(?l)]",  # one is enough
        "sum_{?l : lock} [open(?l)]",  # each has its reward
        "sum_{?l : lock} [forall_{?b : lock} [AFTER(?b, ?l) => open(?b)]]",  # of an object
        "forall_{?l : lock} [turn(?l)]",  # a policy need but choose
        "forall_{?l : lock} [LAST(?l)]",  # nobody can change it
        f"-({ALL})",  # nobody wants it
        f"~({ALL})",
    ],
)
def test_what_is_no_goal(goal):
    assert rewards_of(goal) is None


def test_of_several_those_count_that_are_wanted():
    last = "forall_{?l : lock} [LAST(?l) => open(?l)]"
    reward = rewards_of(f"({ALL}) - 0.5 * ({last})")
    assert [reward(1), reward(LOCKS)] == pytest.approx([10.0 / 7.0, 10.0 / 7.0 - 5.0])


def test_there_is_none_where_an_episode_may_end():
    assert rewards_of(ALL, termination=f"termination {{ {ALL}; }};") is None
