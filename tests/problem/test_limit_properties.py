"""Limits on groups of bools and legal play, against brute force over random groups."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.toys import toy
from hypothesis import given, settings
from hypothesis import strategies as st

from mdpo_rddl.planner.plans.limits import choose_within_limits, scale_to_limits
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.limits import GroupLimit, group_limits
from mdpo_rddl.problem.load import make_environment

SIZE = 6
SUBSETS = np.array(list(itertools.product([False, True], repeat=SIZE)))
# XLA takes denormals for 0
NUMBERS = st.floats(0.0, 1.0, width=32, allow_subnormal=False)
PROBABILITIES = st.lists(NUMBERS, min_size=SIZE, max_size=SIZE).map(np.float32)


@st.composite
def limits(draw, exact=False):
    """One precondition on `SIZE` bools, of which the first four are a matrix."""
    count = draw(st.integers(1, 3))
    group = np.array(draw(st.lists(st.integers(-1, count - 1), min_size=SIZE, max_size=SIZE)))
    most = np.array(draw(st.lists(st.integers(0, 3), min_size=count, max_size=count)))
    groups = {"a": group[:4].reshape(2, 2), "b": group[4:]}
    return GroupLimit(groups, most, exact)


def members(limit):
    """For each group, its members among all bools in a row, and its limit."""
    group = flat(limit.groups)
    return [(np.flatnonzero(group == g), most) for g, most in enumerate(limit.limits)]


def flat(tree):
    return np.concatenate([np.ravel(tree["a"]), np.ravel(tree["b"])])


def tree(values):
    return {"a": jnp.asarray(values[:4].reshape(2, 2)), "b": jnp.asarray(values[4:])}


def keeps(subset, several):
    return all(subset[group].sum() <= most for limit in several for group, most in members(limit))


@given(PROBABILITIES, st.lists(limits(), min_size=1, max_size=3))
def test_scaling_keeps_all_overlapping_limits(p, several):
    scaled = flat(scale_to_limits(tree(p), several))
    assert np.all(scaled >= 0.0)
    assert np.all(scaled <= p)
    for limit in several:
        for group, most in members(limit):
            assert scaled[group].sum() <= most * (1 + 1e-5)
    held = all(p[group].sum() <= most for limit in several for group, most in members(limit))
    if held:
        np.testing.assert_array_equal(scaled, p)


@pytest.mark.long
@given(PROBABILITIES, st.lists(limits(), min_size=1, max_size=3))
def test_choices_keep_all_overlapping_limits(p, several):
    chosen = flat(choose_within_limits(tree(p), several))
    assert keeps(chosen, several)
    assert np.all((p > 0.5) | ~chosen)
    if keeps(p > 0.5, several):
        np.testing.assert_array_equal(chosen, p > 0.5)


@given(PROBABILITIES, limits())
def test_under_one_limit_no_legal_choice_is_likelier(p, limit):
    chosen = flat(choose_within_limits(tree(p), [limit]))
    gains = [np.sum((p - np.float32(0.5))[subset]) for subset in SUBSETS if keeps(subset, [limit])]
    assert np.sum((p - np.float32(0.5))[chosen]) == pytest.approx(max(gains), abs=1e-6)


@given(PROBABILITIES, limits(exact=True))
def test_under_an_exact_limit_as_many_are_chosen_as_it_says(p, limit):
    chosen = flat(choose_within_limits(tree(p), [limit]))
    for group, most in members(limit):
        assert chosen[group].sum() == min(most, len(group))
        if 0 < most < len(group):
            rest = np.setdiff1d(group, np.flatnonzero(chosen))
            assert p[rest].max() <= p[group][chosen[group]].min()


RULES = {
    "forall_{{?s : shop}} [(sum_{{?i : item}} [buy(?s, ?i)]) <= {}];": st.integers(0, 3),
    "forall_{{?s : shop}} [{} >= (sum_{{?i : item}} [buy(?s, ?i)])];": st.just("MOST(?s)"),
    "forall_{{?i : item}} [(sum_{{?s : shop}} [buy(?s, ?i)]) < {}];": st.integers(1, 3),
    "(sum_{{?s : shop, ?i : item}} [buy(?s, ?i)]) + wait <= {};": st.integers(0, 5),
    "(sum_{{?s : shop}} [sum_{{?i : item}} [buy(?s, ?i)]]) <= {};": st.integers(0, 5),
}


@st.composite
def rules(draw):
    chosen = draw(st.lists(st.sampled_from(sorted(RULES)), min_size=1, max_size=3, unique=True))
    return " ".join(rule.format(draw(RULES[rule])) for rule in chosen)


def joint_actions():
    for bits in itertools.product([False, True], repeat=7):
        yield {"buy": np.array(bits[:6]).reshape(2, 3), "wait": bits[6]}


@settings(max_examples=10)
@given(rules(), st.lists(NUMBERS, min_size=7, max_size=7).map(np.float32))
def test_the_limits_allow_what_the_environment_allows(text, p):
    problem = toy("picks", RULES=text)
    several, others = group_limits(problem.model)
    assert others == 0
    env = make_environment(problem, enforce_action_constraints=True)
    env.reset(seed=0)
    referee = Referee(env)
    for action in joint_actions():
        allowed = all(
            np.bincount(
                np.concatenate([np.ravel(g) for g in limit.groups.values()]),
                np.concatenate([np.ravel(action[name]) for name in limit.groups]),
                len(limit.limits),
            )[group]
            <= most
            for limit in several
            for group, most in enumerate(limit.limits)
        )
        verdict = referee.rule(action)
        assert verdict.illegal is not allowed
        # doing nothing is legal here
        assert verdict.fallback is verdict.illegal
        assert not referee.rule(verdict.actions).illegal
    likely = {"buy": jnp.asarray(p[:6].reshape(2, 3)), "wait": jnp.asarray(p[6])}
    chosen = choose_within_limits(likely, several)
    assert not referee.rule({name: np.asarray(value) for name, value in chosen.items()}).illegal
