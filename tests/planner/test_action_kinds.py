"""Noise on every kind of action, and the limits on them, in training and in play."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner, optimize

from mdpo_rddl.noise import AdaptiveNoise, ConstantNoise
from mdpo_rddl.noise.actions import ActionKind
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import initial_values, unit_hyperparams
from mdpo_rddl.planner.upstream import JaxOfflineController
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment

DOMAIN = """
domain kinds {
    types { site : object; };
    pvariables {
        WORTH(site) : { non-fluent, real, default = 1.0 };
        total : { state-fluent, real, default = 0.0 };
        pick(site) : { action-fluent, bool, default = false };
        also : { action-fluent, bool, default = false };
        push : { action-fluent, real, default = 0.0 };
        gear : { action-fluent, int, default = 0 };
    };
    cpfs {
        total' = total + Normal(push, 0.1) + 0.1 * gear
                 + (sum_{?s : site} [WORTH(?s) * pick(?s)]) - also;
    };
    reward = total - push * push;
    action-preconditions { push >= -1.0; push <= 1.0; gear >= -2; gear <= 3; RULE };
}
"""
INSTANCE = """
non-fluents nf {
    domain = kinds;
    objects { site : {s1, s2, s3}; };
    non-fluents { WORTH(s2) = 2.0; };
}
instance one {
    domain = kinds;
    non-fluents = nf;
    max-nondef-actions = LIMIT;
    horizon = 6;
    discount = 1.0;
}
"""

TWO = ConstantNoise(2.0, "absolute")


@pytest.fixture
def problem(tmp_path, request):
    limit, rule = getattr(request, "param", ("pos-inf", ""))
    (tmp_path / "d.rddl").write_text(DOMAIN.replace("RULE", rule))
    (tmp_path / "i.rddl").write_text(INSTANCE.replace("LIMIT", limit))
    return load_problem(str(tmp_path / "d.rddl"), str(tmp_path / "i.rddl"))


def perturbed_actions(planner, scale=5.0, draws=40):
    """Actions of the perturbed policy under large noise, stacked over draws."""
    fluents = initial_values(planner).training.fluents
    hyperparams = unit_hyperparams(planner)
    params, _, _ = planner.initialize(jax.random.PRNGKey(0), hyperparams, fluents)
    params = jax.tree.map(lambda leaf: leaf[0], params)
    state = {name: value[0] for name, value in fluents.items()}

    def act(key):
        shift = {
            name: scale * jax.random.normal(jax.random.fold_in(key, i), spec.shape)
            for i, (name, spec) in enumerate(planner.action_specs.items())
        }
        return planner._perturbed_policy(key, params, hyperparams, 2, state, {}, shift)

    return jax.vmap(act)(jax.random.split(jax.random.PRNGKey(1), draws))


@pytest.mark.parametrize("kind", ["drp", "slp"])
def test_each_tensor_is_perturbed_by_its_own_kind(problem, kind):
    planner = make_planner(MDPOPlanner, problem, make_plan(kind))
    kinds = {name: spec.kind for name, spec in planner.action_specs.items()}
    assert kinds == {
        "pick": ActionKind.BOOL,
        "also": ActionKind.BOOL,
        "push": ActionKind.REAL,
        "gear": ActionKind.INTEGER,
    }
    actions = perturbed_actions(planner)
    for name, low, high in (("pick", 0, 1), ("also", 0, 1), ("push", -1, 1), ("gear", -2, 3)):
        assert np.all((actions[name] >= low) & (actions[name] <= high)), name
        assert np.all(np.ptp(actions[name], axis=0) > 0.5 * (high - low)), name
    assert np.all((actions["pick"] > 0.0) & (actions["pick"] < 1.0))


def test_a_bool_under_unit_logistic_noise_is_binary_concrete(problem):
    """P(action > 1/2) is the probability itself: Maddison et al. (2017), proposition 2."""
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"))
    hyperparams = dict.fromkeys(problem.model.action_fluents, 1.0)
    logit = jnp.array([-1.0, 0.3, 2.0])
    params = {
        "pick": jnp.tile(logit, (6, 1)),
        "also": jnp.zeros(6),
        "push": jnp.zeros(6),
        "gear": jnp.zeros(6),
    }
    keys = jax.random.split(jax.random.PRNGKey(0), 20_000)

    def act(key):
        shift = {"pick": jax.random.logistic(key, (3,))}
        return planner._perturbed_policy(key, params, hyperparams, 0, {}, {}, shift)["pick"]

    share = np.mean(np.asarray(jax.vmap(act)(keys)) > 0.5, axis=0)
    # four standard errors of a share of 20,000
    np.testing.assert_allclose(share, jax.nn.sigmoid(logit), atol=4 * 0.5 / np.sqrt(20_000))


LIMITED = [
    ("drp", {}, ActionKind.CHOICE),
    ("slp", {"wrap_softmax": True}, ActionKind.CHOICE),
    ("slp", {}, ActionKind.BOOL),
    ("slp", {"use_new_projection": True}, ActionKind.BOOL),
    ("slp", {"wrap_sigmoid": False, "min_action_prob": 1e-3}, ActionKind.BOOL),
]


@pytest.mark.parametrize("problem", [("1", "")], indirect=True)
@pytest.mark.parametrize(("kind", "arguments", "law"), LIMITED)
def test_max_nondef_actions_holds_under_noise_at_every_step(problem, kind, arguments, law):
    planner = make_planner(MDPOPlanner, problem, make_plan(kind, **arguments))
    assert {planner.action_specs[name].kind for name in ("pick", "also")} == {law}
    actions = perturbed_actions(planner)
    bools = np.concatenate([actions["pick"], actions["also"][:, np.newaxis]], axis=1)
    if arguments.get("use_new_projection"):
        # that projection bounds how many are above one half, not their sum
        assert np.max(np.sum(bools > 0.5 + 1e-6, axis=1)) <= 1
    else:
        # each of the four bools keeps the smallest probability that JaxPlan grants it
        slack = 4 * arguments.get("min_action_prob", 1e-6)
        assert np.max(np.sum(bools, axis=1)) <= 1.0 + slack + 1e-5
    assert np.all(np.ptp(bools, axis=0) > 0.2), "the noise reaches no bool"


@pytest.mark.parametrize("problem", [("2", "")], indirect=True)
def test_a_top_two_under_noise_sums_to_two(problem):
    planner = make_planner(MDPOPlanner, problem, make_plan("drp"))
    actions = perturbed_actions(planner)
    total = np.sum(actions["pick"], axis=1) + actions["also"]
    np.testing.assert_allclose(total, 2.0, rtol=1e-4)


def test_a_gumbel_perturbed_softmax_chooses_with_the_softmax_s_probabilities(problem):
    problem.model.max_allowed_actions = 1
    planner = make_planner(MDPOPlanner, problem, make_plan("slp", wrap_softmax=True))
    hyperparams = dict.fromkeys(problem.model.action_fluents, 1.0)
    logits = jnp.array([0.0, 1.0, -1.0, 0.5])
    params = {"push": jnp.zeros(6), "gear": jnp.zeros(6), "bool__": jnp.tile(logits, (6, 1))}
    keys = jax.random.split(jax.random.PRNGKey(0), 20_000)

    def chosen(key):
        gumbel = jax.random.gumbel(key, (4,))
        shift = {"pick": gumbel[:3], "also": gumbel[3]}
        actions = planner._perturbed_policy(key, params, hyperparams, 0, {}, {}, shift)
        return jnp.argmax(jnp.append(actions["pick"], actions["also"]))

    share = np.bincount(jax.vmap(chosen)(keys), minlength=4) / 20_000
    np.testing.assert_allclose(share, jax.nn.softmax(logits), atol=4 * 0.5 / np.sqrt(20_000))


RULE = "(sum_{?s : site} [pick(?s)]) <= 1;"


@pytest.mark.parametrize("problem", [("pos-inf", RULE)], indirect=True)
@pytest.mark.parametrize("kind", [pytest.param("drp", marks=pytest.mark.long), "slp"])
def test_group_limits_hold_in_training_and_in_play(problem, kind):
    planner = make_planner(
        MDPOPlanner,
        problem,
        make_plan(kind),
        noise=TWO,
        optimizer_kwargs={"learning_rate": 0.1},
    )
    actions = perturbed_actions(planner)
    assert np.max(np.sum(actions["pick"], axis=1)) <= 1.0 + 1e-5
    callback = optimize(planner, 60)
    env = make_environment(problem, enforce_action_constraints=True)
    policy = playable(planner, callback["best_params"], callback["policy_hyperparams"], 0)
    # worth 2, the second site is the best single one; all three together would be better still
    for step in range(4):
        action = policy(step, {"total": np.zeros(())})
        assert action["pick"].tolist() == [False, True, False]
        assert (bool(action["also"]), int(action["gear"])) == (False, 3)
        assert float(action["push"]) == pytest.approx(1.0, abs=0.05)
    found = evaluate(env, policy, 3, seed=0)
    assert found.illegal_actions == 0
    # the best: push 1 four times, then 1/2, then 0; what a step adds counts in all later ones
    best = (5 + 4 + 3 + 2) * (1.0 + 2.3) - 4 + (0.5 + 2.3 - 0.25)
    # four standard errors of the mean of three episodes, and some for what is not trained out
    chance = 4 * 0.1 * np.sqrt((25 + 16 + 9 + 4 + 1) / 3)
    assert best - 0.1 * best - chance < found.mean < best + chance


@pytest.mark.parametrize("problem", [("pos-inf", RULE)], indirect=True)
def test_group_limits_can_be_left_to_jaxplan(problem):
    planner = make_planner(
        MDPOPlanner,
        problem,
        make_plan("slp"),
        noise=TWO,
        keep_group_limits=False,
    )
    actions = perturbed_actions(planner)
    assert np.max(np.sum(actions["pick"], axis=1)) > 1.5


def test_jaxplan_s_controller_plays_legally_where_a_bound_rounds_up():
    problem = load_problem("Reservoir_ippc2023", "4", 4)
    top = np.asarray(problem.model.non_fluents["TOP_RES"])
    assert np.any(top.astype(np.float32) > top)
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"))
    params = {"release": jnp.full((4, 15), 1e4)}
    agent = JaxOfflineController(planner, key=jax.random.PRNGKey(0), params=params)
    env = make_environment(problem, enforce_action_constraints=True)
    agent.eval_hyperparams = {"release": 1.0}
    assert np.isfinite(agent.evaluate(env, episodes=1, seed=0)["mean"])


TERMINAL = """
domain race {
    pvariables {
        STEP : { non-fluent, real, default = 0.0 };
        x : { state-fluent, real, default = 0.0 };
        go : { action-fluent, real, default = 0.0 };
    };
    cpfs { x' = x + STEP * go; };
    reward = x + 1.0;
    termination { x >= 2.0; };
    action-preconditions { go >= 1.0; go <= 1.0; };
}
"""


@pytest.mark.long
def test_reward_after_termination_counts_only_where_it_is_asked_to(tmp_path):
    (tmp_path / "d.rddl").write_text(TERMINAL)
    instance = INSTANCE.replace("kinds", "race").replace("LIMIT", "pos-inf")
    instance = instance.replace("objects { site : {s1, s2, s3}; };", "")
    (tmp_path / "i.rddl").write_text(instance.replace("WORTH(s2) = 2.0;", "STEP = 1.0;"))
    problem = load_problem(str(tmp_path / "d.rddl"), str(tmp_path / "i.rddl"))
    env = make_environment(problem)
    exact = evaluate(env, lambda step, state: {"go": 1.0}, 1, seed=0)
    assert exact.lengths.tolist() == [2]
    # x is 0, 1, 2, 3, 4, 5 before each step; the episode ends after the second
    assert exact.returns.tolist() == [1.0 + 2.0]
    for noise in (ConstantNoise(0.0), AdaptiveNoise(0.0, 1.0)):
        for stop, expected in ((True, 3.0), (False, 21.0)):
            planner = make_planner(
                MDPOPlanner, problem, make_plan("slp"), noise=noise, stop_at_termination=stop
            )
            callback = optimize(planner, 2)
            assert callback["train_return"].tolist() == [expected]
            assert callback["test_return"].tolist() == [expected]
