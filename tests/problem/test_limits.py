"""At most k of a group of bools: what is read as such a limit, and that it holds."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.planner.plans.limits import choose_within_limits, scale_to_limits
from mdpo_rddl.problem.limits import GroupLimit, group_limits
from mdpo_rddl.problem.load import load_problem

DOMAIN = """
domain picks {{
    types {{ shop : object; item : object; }};
    pvariables {{
        MOST(shop) : {{ non-fluent, int, default = 2 }};
        FEW : {{ non-fluent, int, default = 1 }};
        stock : {{ state-fluent, real, default = 0.0 }};
        buy(shop, item) : {{ action-fluent, bool, default = false }};
        sell(item, shop) : {{ action-fluent, bool, default = false }};
        wait : {{ action-fluent, bool, default = false }};
        price(item) : {{ action-fluent, real, default = 0.0 }};
    }};
    cpfs {{ stock' = stock + (sum_{{?s : shop, ?i : item}} [buy(?s, ?i)]); }};
    reward = stock;
    action-preconditions {{ {precondition}; }};
}}
"""
INSTANCE = """
non-fluents nf {
    domain = picks;
    objects { shop : {s1, s2}; item : {i1, i2, i3}; };
    non-fluents { MOST(s2) = 1; };
}
instance one {
    domain = picks;
    non-fluents = nf;
    max-nondef-actions = pos-inf;
    horizon = 3;
    discount = 1.0;
}
"""


def limits_of(tmp_path, precondition):
    (tmp_path / "d.rddl").write_text(DOMAIN.format(precondition=precondition))
    (tmp_path / "i.rddl").write_text(INSTANCE)
    problem = load_problem(str(tmp_path / "d.rddl"), str(tmp_path / "i.rddl"))
    return group_limits(problem.model)


SUM = "(sum_{?i : item} [buy(?s, ?i)])"


@pytest.mark.parametrize(
    ("precondition", "limits", "exact"),
    [
        (f"forall_{{?s : shop}} [{SUM} <= 1]", [1, 1], False),
        (f"forall_{{?s : shop}} [{SUM} < 3]", [2, 2], False),
        (f"forall_{{?s : shop}} [2 >= {SUM}]", [2, 2], False),
        (f"forall_{{?s : shop}} [{SUM} <= MOST(?s)]", [2, 1], False),
        (f"forall_{{?s : shop}} [{SUM} == FEW]", [1, 1], True),
    ],
)
def test_limits_per_shop(tmp_path, precondition, limits, exact):
    (limit,), others = limits_of(tmp_path, precondition)
    assert others == 0
    assert limit.limits.tolist() == limits
    assert limit.exact is exact
    assert {name: group.tolist() for name, group in limit.groups.items()} == {
        "buy": [[0, 0, 0], [1, 1, 1]]
    }


def test_one_group_over_several_fluents(tmp_path):
    everything = "(sum_{?s : shop, ?i : item} [buy(?s, ?i)]) + wait"
    (limit,), _ = limits_of(tmp_path, f"({everything}) <= 1")
    assert limit.limits.tolist() == [1]
    assert {name: group.tolist() for name, group in limit.groups.items()} == {
        "buy": [[0] * 3] * 2,
        "wait": 0,
    }


def test_the_group_follows_the_fluent_s_own_order_of_parameters(tmp_path):
    precondition = "forall_{?s : shop} [(sum_{?i : item} [buy(?s, ?i) + sell(?i, ?s)]) <= 1]"
    (limit,), _ = limits_of(tmp_path, precondition)
    assert limit.groups["sell"].tolist() == [[0, 1]] * 3
    assert limit.groups["buy"].tolist() == [[0] * 3, [1] * 3]


@pytest.mark.parametrize(
    ("precondition", "others"),
    [
        ("forall_{?i : item} [price(?i) <= 3]", 0),
        ("forall_{?i : item} [(price(?i) >= 0) ^ (price(?i) <= 3)]", 0),
        ("(sum_{?i : item} [price(?i)]) <= 3", 1),
        (f"forall_{{?s : shop}} [{SUM} >= 1]", 1),
        ("forall_{?s : shop, ?i : item} [buy(?s, ?i) => ~wait]", 1),
        (f"forall_{{?s : shop}} [({SUM} + wait) <= 1]", 1),  # wait is in every group
        ("(sum_{?s : shop, ?i : item} [2 * buy(?s, ?i)]) <= 1", 1),
        ("forall_{?i : item} [price(?i) <= stock]", 1),
    ],
)
def test_what_is_no_such_limit(tmp_path, precondition, others):
    assert limits_of(tmp_path, precondition) == ([], others)


def test_recsim_s_rule():
    (limit,), others = group_limits(load_problem("RecSim_ippc2023", "1").model)
    assert others == 0
    consumers, items = limit.groups["recommend"].shape
    expected = np.repeat(np.arange(consumers), items).reshape(consumers, items)
    np.testing.assert_array_equal(limit.groups["recommend"], expected)
    assert limit.limits.tolist() == [1] * consumers


TWO_GROUPS = GroupLimit(
    {"a": np.array([0, 0, 1, -1]), "b": np.array([1, 0])}, np.array([1, 2]), exact=False
)


def test_scaling_worked_by_hand():
    a, b = jnp.array([0.9, 0.6, 0.3, 1.0]), jnp.array([0.4, 0.5])
    scaled = scale_to_limits({"a": a, "b": b}, [TWO_GROUPS])
    # group 0 sums to 2.0 and is halved, group 1 to 0.7 and stays
    np.testing.assert_allclose(scaled["a"], [0.45, 0.3, 0.3, 1.0], rtol=1e-6)
    np.testing.assert_allclose(scaled["b"], [0.4, 0.25], rtol=1e-6)


def test_scaling_keeps_every_limit_and_a_finite_gradient():
    draws = jax.random.uniform(jax.random.PRNGKey(0), (200, 6))
    draws = draws.at[0].set(0.0).at[1].set(1.0)

    def total(draw):
        scaled = scale_to_limits({"a": draw[:4], "b": draw[4:]}, [TWO_GROUPS])
        return jnp.sum(scaled["a"] ** 2) + jnp.sum(scaled["b"]), scaled

    gradients, scaled = jax.vmap(jax.grad(total, has_aux=True))(draws)
    assert np.all(np.isfinite(gradients))
    a, b = scaled["a"], scaled["b"]
    assert np.max(a[:, 0] + a[:, 1] + b[:, 1]) <= 1.0 + 1e-6
    assert np.max(a[:, 2] + b[:, 0]) <= 2.0 + 1e-6


@pytest.mark.parametrize("exact", [False, True])
def test_choices_keep_every_limit_and_are_the_likeliest(exact):
    groups = {"a": np.array([0, 1, 0, 1, 0]), "b": np.array([[1, -1], [0, 1]])}
    limit = GroupLimit(groups, np.array([2, 1]), exact)
    flat = np.concatenate([np.ravel(groups["a"]), np.ravel(groups["b"])])
    rng = np.random.default_rng(0)
    for _ in range(50):
        p = rng.uniform(size=9).astype(np.float32)
        given = {"a": jnp.asarray(p[:5]), "b": jnp.asarray(p[5:].reshape(2, 2))}
        chosen = choose_within_limits(given, [limit])
        got = np.concatenate([np.ravel(chosen["a"]), np.ravel(chosen["b"])])
        expected = p > 0.5
        for g, most in ((0, 2), (1, 1)):
            members = np.flatnonzero(flat == g)
            best = members[np.argsort(-p[members])][:most]
            expected[members] = np.isin(members, best) & (exact | (p[members] > 0.5))
        np.testing.assert_array_equal(got, expected)


def test_several_limits_hold_together():
    rows = GroupLimit({"x": np.array([[0] * 3, [1] * 3])}, np.array([1, 1]))
    columns = GroupLimit({"x": np.array([[0, 1, 2]] * 2)}, np.array([1, 1, 1]))
    for p in itertools.islice(itertools.permutations(np.linspace(0.55, 0.95, 6)), 0, 720, 7):
        x = choose_within_limits({"x": jnp.array(p).reshape(2, 3)}, [rows, columns])["x"]
        assert np.all(x.sum(0) <= 1)
        assert np.all(x.sum(1) <= 1)
        assert x.any()


def test_of_equals_the_first_are_chosen_and_none_where_none_may_be():
    limit = GroupLimit({"x": np.array([0, 0, 0, 1, 1, -1])}, np.array([2, 0]))
    chosen = choose_within_limits({"x": jnp.full(6, 0.6)}, [limit])
    assert chosen["x"].tolist() == [True, True, False, False, False, True]
