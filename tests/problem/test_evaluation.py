"""The exact evaluator, against episodes played out here step by step and worked by hand."""

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.toys import problem_from, toy, toy_text
from pyRDDLGym import RDDLEnv
from scipy import stats

from mdpo_rddl.problem.evaluation import (
    Evaluation,
    difference,
    episode_seeds,
    evaluate,
    lost_worth,
    student_quantile,
)
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

ROOT = Path(__file__).resolve().parents[2]

# A cart is pushed along a line. The tests change words of it.
DOMAIN = """
domain cart {
    types { wheel : object; };
    pvariables {
        SPREAD : { non-fluent, real, default = 0.0 };
        x : { state-fluent, real, default = 0.0 };
        push : { action-fluent, real, default = 0.0 };
        drive(wheel) : { action-fluent, real, default = 0.0 };
        gear : { action-fluent, int, default = 0 };
        brake : { action-fluent, bool, default = false };
    };
    cpfs {
        x' = if (brake) then x
             else x + push + gear + (sum_{?w : wheel} [drive(?w)]) + Normal(0.0, SPREAD);
    };
    reward = x';
    action-preconditions {
        push >= -1.0;
        push <= 1.0;
        gear >= 0;
        gear <= 3;
        forall_{?w : wheel} [drive(?w) >= 0.0];
        forall_{?w : wheel} [drive(?w) <= 2.0];
        (sum_{?w : wheel} [drive(?w)]) <= 3.0;
    };
    // more blocks
}
"""

INSTANCE = """
non-fluents nf_cart {
    domain = cart;
    objects { wheel : {left, right}; };
    non-fluents { SPREAD = 0.0; };
}
instance one {
    domain = cart;
    non-fluents = nf_cart;
    init-state { x = 0.0; };
    max-nondef-actions = pos-inf;
    horizon = 8;
    discount = 0.5;
}
"""


SPREAD = {"SPREAD = 0.0": "SPREAD = 1.0"}
GOAL = {"// more blocks": "termination { x >= 3.0; };"}


def cart(folder: Path, changes: dict[str, str] | None = None) -> Problem:
    texts = {"cart.rddl": DOMAIN, "one.rddl": INSTANCE}
    for old, new in (changes or {}).items():
        assert sum(text.count(old) for text in texts.values()) == 1
        texts = {name: text.replace(old, new) for name, text in texts.items()}
    for name, text in texts.items():
        (folder / name).write_text(text)
    return load_problem(*(str(folder / name) for name in texts))


@pytest.fixture
def reservoir() -> Problem:
    domain, instance = ROOT / "domains/reservoir.rddl", ROOT / "instances/reservoir15.rddl"
    return load_problem(str(domain), str(instance), horizon=6)


def constant(**actions: object) -> Callable:
    return lambda step, state: actions


def played_out(
    problem: Problem, policy: Callable, seed: int, episodes: int
) -> tuple[list[float], list[int]]:
    """Returns and lengths, from an environment and seeds of the test's own."""
    env = make_environment(problem)
    returns, lengths = [], []
    for episode in range(episodes):
        (env_seed,) = np.random.SeedSequence([seed, episode]).generate_state(1)
        state, _ = env.reset(seed=int(env_seed))
        rewards: list[float] = []
        while not env.done:
            state, reward, *_ = env.step(policy(len(rewards), state))
            rewards.append(float(reward))
        # no `sum`, which Python 3.12 makes more exact than additions
        found, weight = 0.0, 1.0
        for reward in rewards:
            found, weight = found + weight * reward, weight * problem.model.discount
        returns.append(found)
        lengths.append(len(rewards))
    return returns, lengths


# --- the returns ---------------------------------------------------------------------------


def test_returns_on_a_shipped_problem_are_those_of_a_loop_written_out(reservoir):
    def policy(step, state):
        return {"release": 0.1 * (step + 1) * state["rlevel"]}

    found = evaluate(make_environment(reservoir), policy, episodes=3, seed=5)
    returns, lengths = played_out(reservoir, policy, seed=5, episodes=3)
    assert found.returns.tolist() == returns
    assert found.lengths.tolist() == lengths == [6, 6, 6]
    assert found.illegal_actions == 0
    assert len(set(returns)) == 3


def test_discounted_returns_of_a_random_problem_are_those_of_a_loop_written_out(tmp_path):
    problem = cart(tmp_path, SPREAD)

    def policy(step, state):
        return {"push": np.clip(-state["x"][0] / (step + 1), -1.0, 1.0)}

    found = evaluate(make_environment(problem), policy, episodes=4, seed=11)
    returns, lengths = played_out(problem, policy, seed=11, episodes=4)
    assert found.returns.tolist() == returns
    assert found.lengths.tolist() == lengths == [8, 8, 8, 8]


def test_the_first_reward_is_not_discounted(tmp_path):
    # x = 1, 2, ... 8 after the steps, discounted by 1/2 each
    found = evaluate(make_environment(cart(tmp_path)), constant(push=1.0), episodes=1, seed=0)
    assert found.returns.tolist() == [sum((t + 1) / 2**t for t in range(8))]


def test_the_policy_sees_the_steps_and_the_states_it_made(tmp_path):
    seen = []

    def policy(step, state):
        seen.append((step, float(state["x"][0])))
        return {"gear": 2}

    evaluate(make_environment(cart(tmp_path)), policy, episodes=2, seed=0)
    assert seen == 2 * [(t, 2.0 * t) for t in range(8)]


# --- how episodes end ----------------------------------------------------------------------


def test_a_termination_condition_ends_the_episode(tmp_path):
    problem = cart(tmp_path, GOAL)
    found = evaluate(make_environment(problem), constant(push=1.0), episodes=2, seed=0)
    assert found.lengths.tolist() == [3, 3]
    assert found.returns.tolist() == [1 + 2 / 2 + 3 / 4] * 2


def test_episodes_of_random_length_are_those_of_a_loop_written_out(tmp_path):
    problem = cart(tmp_path, GOAL | SPREAD)
    policy = constant(push=0.5)
    found = evaluate(make_environment(problem), policy, episodes=8, seed=3)
    returns, lengths = played_out(problem, policy, seed=3, episodes=8)
    assert found.returns.tolist() == returns
    assert found.lengths.tolist() == lengths
    assert min(lengths) < 8 < max(lengths) + 1
    assert len(set(lengths)) > 2


def test_a_violated_state_invariant_ends_the_episode_after_its_reward(tmp_path):
    problem = cart(tmp_path, {"// more blocks": "state-invariants { x <= 2.5; };"})
    found = evaluate(make_environment(problem), constant(push=1.0), episodes=1, seed=0)
    assert found.lengths.tolist() == [3]
    assert found.returns.tolist() == [1 + 2 / 2 + 3 / 4]


def test_an_episode_that_is_over_at_the_start_has_no_step(tmp_path):
    def policy(step, state):
        raise AssertionError("there is nothing to decide")

    problem = cart(tmp_path, GOAL | {"x = 0.0": "x = 4.0"})
    found = evaluate(make_environment(problem), policy, episodes=2, seed=0)
    assert found.lengths.tolist() == [0, 0]
    assert found.returns.tolist() == [0.0, 0.0]


# --- seeds ---------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_returns_whatever_was_played_before(tmp_path):
    problem = cart(tmp_path, SPREAD)
    env = make_environment(problem)
    first = evaluate(env, constant(), episodes=3, seed=7)
    evaluate(env, constant(push=1.0), episodes=2, seed=1)
    again = evaluate(env, constant(), episodes=3, seed=7)
    assert again.returns.tolist() == first.returns.tolist()


def test_the_first_episodes_do_not_depend_on_their_number(tmp_path):
    problem = cart(tmp_path, SPREAD)
    few = evaluate(make_environment(problem), constant(), episodes=2, seed=7)
    many = evaluate(make_environment(problem), constant(), episodes=5, seed=7)
    assert many.returns[:2].tolist() == few.returns.tolist()
    assert len(set(many.returns.tolist())) == 5


def test_no_two_runs_share_an_episode(tmp_path):
    problem = cart(tmp_path, SPREAD)
    returns = [
        value
        for seed in (0, 1, 2)
        for value in evaluate(make_environment(problem), constant(), 4, seed).returns.tolist()
    ]
    assert len(set(returns)) == 12


def test_episode_seeds_are_pinned():
    # derived by numpy's SeedSequence, whose stream numpy keeps across versions
    assert episode_seeds(0, 2) == [2968811710, 3964924996]
    assert episode_seeds(2**31 - 1, 1) == [1926950122]


def test_episodes_may_have_given_seeds():
    assert episode_seeds([5, 1, 9], 2) == [5, 1]
    with pytest.raises(ValueError, match="4 episodes need as many seeds, not 3"):
        episode_seeds([5, 1, 9], 4)


# --- the actions ---------------------------------------------------------------------------


def test_a_bound_rounded_up_to_32_bit_stays_legal(reservoir):
    top = np.asarray(reservoir.model.non_fluents["TOP_RES"], np.float64)
    rounded = top.astype(np.float32)
    assert (rounded.astype(np.float64) > top).any()
    env = make_environment(reservoir)
    env.reset(seed=0)
    assert not env.sampler.check_action_preconditions({"release": rounded}, silent=True)
    assert evaluate(env, constant(release=rounded), 2, seed=0).illegal_actions == 0


def test_a_lower_bound_rounded_down_to_32_bit_stays_legal(tmp_path):
    problem = cart(tmp_path, {"push >= -1.0": "push >= -0.1"})
    assert float(np.float32(-0.1)) < -0.1
    found = evaluate(make_environment(problem), constant(push=np.float32(-0.1)), 1, seed=0)
    assert found.illegal_actions == 0
    exact, _ = played_out(problem, constant(push=-0.1), seed=0, episodes=1)
    assert found.returns.tolist() == exact


def test_real_actions_outside_the_box_are_clipped_before_they_are_played(tmp_path):
    env = make_environment(cart(tmp_path))
    beyond = evaluate(env, constant(push=9.0, drive=np.array([-5.0, 7.0])), 1, seed=0)
    at_bound = evaluate(env, constant(push=1.0, drive=np.array([0.0, 2.0])), 1, seed=0)
    assert beyond.returns.tolist() == at_bound.returns.tolist()
    assert beyond.returns.tolist() == [sum(3 * (t + 1) / 2**t for t in range(8))]
    assert beyond.illegal_actions == 0


def test_an_illegal_action_is_counted_and_the_do_nothing_action_played(tmp_path):
    env = make_environment(cart(tmp_path))
    found = evaluate(env, constant(gear=5), 1, seed=0)
    idle = evaluate(env, constant(), 1, seed=0)
    assert found.returns.tolist() == idle.returns.tolist()
    assert (found.illegal_actions, found.fallback_actions) == (8, 8)
    assert (idle.illegal_actions, idle.fallback_actions) == (0, 0)
    braked = evaluate(env, constant(gear=3, brake=True), 1, seed=0)
    assert braked.returns.tolist() == [0.0]
    assert braked.illegal_actions == 0


def test_actions_that_break_a_precondition_which_is_no_box_are_counted(tmp_path):
    def policy(step, state):
        return {"drive": np.array([2.0, 2.0 if step % 4 == 1 else 1.0])}  # sum 4 at steps 1, 5

    found = evaluate(make_environment(cart(tmp_path)), policy, episodes=3, seed=0)
    assert (found.illegal_actions, found.fallback_actions) == (3 * 2, 3 * 2)
    # the nearest that keeps it is played instead: x grows by 3 at all steps
    x = np.cumsum([3] * 8)
    assert found.returns.tolist() == [sum(x[t] / 2**t for t in range(8))] * 3


def test_a_precondition_that_is_no_box_warns_once_not_at_each_evaluation(tmp_path):
    problem = cart(tmp_path, {"push <= 1.0": "push <= 1.0 + x"})
    env = make_environment(problem)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = evaluate(env, constant(push=2.0), 1, seed=0)
    # x is 0 at the first step only
    assert (found.illegal_actions, found.fallback_actions) == (1, 1)


def test_where_doing_nothing_is_illegal_too_the_proposal_is_played(tmp_path):
    problem = cart(tmp_path, {"push >= -1.0": "push + gear >= 2.5"})
    env = make_environment(problem)
    found = evaluate(env, constant(push=0.5), 1, seed=0)
    assert (found.illegal_actions, found.fallback_actions) == (8, 0)
    # x grows, but what is illegal pays nothing
    assert found.returns.tolist() == [0.0]
    assert found.unmet == ("( push + gear ) >= 2.5",)


def test_where_doing_nothing_is_illegal_too_the_nearest_legal_action_is_played(tmp_path):
    problem = cart(tmp_path, {"push >= -1.0": "push + gear >= 1.0"})
    found = evaluate(make_environment(problem), constant(push=0.5), 1, seed=0)
    assert (found.illegal_actions, found.fallback_actions) == (8, 8)


def test_an_environment_that_is_not_vectorized_is_refused(tmp_path):
    env = RDDLEnv(cart(tmp_path).model, None, vectorized=False)
    with pytest.raises(ValueError, match="vectorized=True"):
        evaluate(env, constant(), 1, seed=0)


def test_every_episode_is_reported_once(tmp_path):
    seen = []
    problem = cart(tmp_path, SPREAD)
    evaluate(make_environment(problem), constant(), 4, 0, on_episode=lambda: seen.append(len(seen)))
    assert seen == [0, 1, 2, 3]


# --- the figures ---------------------------------------------------------------------------


def figures(*returns: float) -> Evaluation:
    lengths = np.full(len(returns), 8)
    return Evaluation(np.array(returns), lengths, illegal_actions=0, fallback_actions=0)


def test_figures_worked_by_hand():
    found = figures(1.0, 2.0, 3.0, 4.0)
    assert found.mean == 2.5
    assert found.std == pytest.approx(math.sqrt(5 / 3), rel=1e-15)
    # a t-table's 3.182446 for 3 degrees of freedom and 97.5%
    half = 3.182446305284263 * math.sqrt(5 / 3) / 2
    assert found.ci95 == pytest.approx((2.5 - half, 2.5 + half), rel=1e-12)


def test_standard_deviation_by_the_sum_of_pairwise_differences():
    returns = [-123.5, 7.25, 980.0, 11.0, -3.5]
    # the variance is half the mean squared difference of two distinct returns
    pairs = [(a - b) ** 2 for i, a in enumerate(returns) for b in returns[:i]]
    assert figures(*returns).std == pytest.approx(math.sqrt(sum(pairs) / len(pairs) / 2), rel=1e-14)


def test_two_episodes_have_a_wide_interval():
    # 12.7062 standard errors, for 1 degree of freedom; the standard error is |a - b| / 2
    low, high = figures(0.0, 2.0).ci95
    assert (low, high) == pytest.approx((1 - 12.706204736174694, 1 + 12.706204736174694))


def test_one_episode_has_no_interval_and_no_spread():
    found = figures(-17.0)
    assert (found.mean, found.std, found.ci95) == (-17.0, 0.0, None)


PIT = {"RISK": "1.0", "REST": "0.0", "FALLEN": "false", "DISCOUNT": "1.0"}


def test_steps_that_nobody_may_play_pay_nothing():
    def deep(step, state):
        return {"deep": np.array(True), "flat": np.array(False)}

    found = evaluate(make_environment(toy("pit", **PIT)), deep, 2, 0)
    # the environment pays 5 at each of them
    assert found.returns.tolist() == [5.0, 5.0]
    assert found.unplayable.tolist() == [3, 3]
    assert (found.illegal_actions, found.fallback_actions) == (6, 0)
    assert found.unmet == ("~fallen",)
    np.testing.assert_allclose(found.worth, [lost_worth(3 / 4)] * 2)


def test_nor_less_than_the_worst_legal_step():
    text = toy_text("pit", **PIT).replace("5.0 * deep + 2.0 * flat", "-3.0 * deep - 2.0 * flat")
    found = evaluate(make_environment(problem_from(text)), lambda step, state: {}, 1, 0)
    # the no-op is illegal: one of both is done, then nothing, which would cost nothing
    assert found.returns.tolist() == [4 * -3.0]
    assert found.unplayable.tolist() == [3]


def test_an_episode_without_such_steps_is_worth_what_it_returns():
    def flat(step, state):
        return {"flat": np.array(True)}

    found = evaluate(make_environment(toy("pit", **PIT)), flat, 1, 0)
    assert found.worth.tolist() == found.returns.tolist() == [8.0]
    assert found.unmet == ()


@pytest.mark.parametrize("degrees", [1, 1.5, 2, 7.3, 19, 127, 1e4, 1e6, 1e8, 1e12, math.inf])
def test_the_quantile_of_students_law(degrees):
    expected = stats.norm.ppf(0.975) if math.isinf(degrees) else stats.t.ppf(0.975, degrees)
    assert student_quantile(degrees) == pytest.approx(expected, rel=1e-7)


def test_the_difference_of_means_has_welchs_interval():
    rng = np.random.default_rng(0)
    one, other = rng.normal(1.0, 2.0, 20), rng.normal(0.0, 5.0, 300)
    expected = stats.ttest_ind(one, other, equal_var=False).confidence_interval(0.95)
    assert difference(one, other) == pytest.approx(tuple(expected), rel=1e-7)
    assert difference(one, np.zeros(1)) is None
    assert difference(np.ones(3), np.zeros(2)) == (1.0, 1.0)
