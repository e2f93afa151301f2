"""What is played where a policy's action is illegal, and doing nothing perhaps too."""

import numpy as np
import pytest

from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import load_problem, make_environment

DOMAIN = """
domain picks {
    types { item : object; };
    pvariables {
        s : { state-fluent, real, default = 0.0 };
        pick(item) : { action-fluent, bool, default = false };
        stay : { action-fluent, bool, default = true };
        push : { action-fluent, real, default = 0.0 };
        pull : { action-fluent, real, default = 0.0 };
    };
    cpfs { s' = s + push; };
    reward = s;
    action-preconditions { RULE; push <= 1.0; pull <= 1.0; };
}
"""
INSTANCE = """
non-fluents nf { domain = picks; objects { item : {a, b, c}; }; }
instance one {
    domain = picks; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 3; discount = 1.0;
}
"""


def verdict(folder, rule, **proposal):
    (folder / "d.rddl").write_text(DOMAIN.replace("RULE", rule))
    (folder / "i.rddl").write_text(INSTANCE)
    problem = load_problem(str(folder / "d.rddl"), str(folder / "i.rddl"))
    env = make_environment(problem, enforce_action_constraints=True)
    env.reset(seed=0)
    ruled = Referee(env).rule({name: np.asarray(value) for name, value in proposal.items()})
    if not ruled.illegal or ruled.fallback:
        env.step(ruled.actions)  # refuses what is illegal
    return ruled


EXACTLY_ONE = "(sum_{?i : item} [pick(?i)]) == 1"


@pytest.mark.parametrize(
    ("rule", "picked", "played"),
    [
        (EXACTLY_ONE, [0, 1, 0], [0, 1, 0]),
        # one of those that were picked
        (EXACTLY_ONE, [0, 1, 1], [0, 1, 0]),
        # or any
        (EXACTLY_ONE, [0, 0, 0], [1, 0, 0]),
        ("forall_{?i : item} [pick(?i)]", [1, 0, 1], [1, 1, 1]),
        ("(sum_{?i : item} [pick(?i)]) <= 1", [1, 0, 1], [0, 0, 0]),
    ],
)
def test_the_nearest_legal_action_is_played(tmp_path, rule, picked, played):
    ruled = verdict(tmp_path, rule, pick=np.array(picked, bool), push=0.5)
    assert ruled.actions["pick"].tolist() == played
    assert ruled.illegal is ruled.fallback is (picked != played)
    # whatever is not a bool does nothing then
    assert ruled.actions["push"] == (0.0 if ruled.fallback else 0.5)


@pytest.mark.parametrize(
    ("rule", "push", "pull"),
    [
        # what is rounded to 32 bit may be on the wrong side of a bound in 64 bit
        ("push <= s + 0.3", float(np.float32(0.3)), 0.0),
        ("push >= s + 0.3000001", 0.3, 0.0),
        # the other one is at the end of its box
        ("push >= s + 0.3000001", 0.3, 1.0),
    ],
)
def test_a_number_that_misses_a_bound_by_rounding_is_legal(tmp_path, rule, push, pull):
    ruled = verdict(tmp_path, rule, push=push, pull=pull)
    assert (ruled.illegal, ruled.fallback) == (False, False)
    assert ruled.actions["push"] == pytest.approx(push, rel=2e-5)
    assert ruled.actions["push"] != push
    assert ruled.actions["pull"] == pytest.approx(pull, rel=2e-5)


def test_a_number_that_misses_a_bound_by_more_is_not(tmp_path):
    ruled = verdict(tmp_path, "push <= s + 0.3", push=0.3001)
    assert (ruled.illegal, ruled.fallback) == (True, True)
    assert ruled.actions["push"] == pytest.approx(0.3)


def test_a_bool_without_parameters_that_must_not_keep_its_default(tmp_path):
    ruled = verdict(tmp_path, "~stay", stay=True)
    assert (ruled.actions["stay"], ruled.illegal, ruled.fallback) == (False, True, True)
    assert ruled.actions["pick"].tolist() == [False] * 3


def test_where_nothing_legal_is_found_the_proposal_stands(tmp_path):
    ruled = verdict(tmp_path, "(sum_{?i : item} [pick(?i)]) == 2", pick=np.array([True] * 3))
    assert (ruled.illegal, ruled.fallback) == (True, False)
    assert ruled.actions["pick"].tolist() == [True] * 3


@pytest.mark.parametrize("number", [np.nan, -np.inf])
def test_what_is_not_finite_is_illegal_where_there_is_no_box_too(tmp_path, number):
    rule = "(sum_{?i : item} [pick(?i)]) <= 1"
    ruled = verdict(tmp_path, rule, pick=np.array([0, 1, 0], bool), push=number)
    assert (ruled.illegal, ruled.fallback) == (True, True)
    assert ruled.actions["push"] == 0.0
