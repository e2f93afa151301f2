"""Policy iteration, where the best policy is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import assert_same_bits
from helpers.toys import problem_from, toy

from mdpo_rddl.planner.config.fitting import greedy
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.policy_iteration.learner import Learning, PolicyIteration, Way
from mdpo_rddl.problem.evaluation import lost_worth

# a program of its own is compiled for them all
pytestmark = pytest.mark.long
KEY = jax.random.PRNGKey(1)
QUICK = Learning(rollouts=64, updates=20, minibatch=128)
# the lamp and the last cell pay only together, from the fifth step on at the earliest
MOST = 7.0


@pytest.fixture(scope="module")
def quest():
    """Its planners: of the greedy policy, and of a feedback policy that guides it."""
    problem, config = toy("quest"), auto_preset("quest").without_section("Search")
    return build_planner(problem, greedy(config)).planner, build_planner(problem, config).planner


@pytest.fixture(scope="module")
def iteration(quest):
    return PolicyIteration(quest[0], quest[1].plan, QUICK)


@pytest.fixture(scope="module")
def noop(quest):
    return quest[1].plan.initializer(KEY, {}, None)


@pytest.fixture(scope="module")
def begun(iteration, noop):
    """The learner after the first iteration, and what the guide has shown there."""
    way = Way(np.float32(3e-3), is_first=np.array(True))
    return iteration.iterate(iteration.begin(np.random.default_rng(0)), KEY, noop, way)


@pytest.mark.parametrize("samples", [1, 3])
def test_explored_rollouts_decide_by_the_samples_of_rollouts(monkeypatch, quest, samples):
    plan, seen = quest[0].plan, []

    def gains(self, params, key, state, step, samples=None):
        seen.append(samples)
        return jnp.zeros(self.size)

    monkeypatch.setattr(GreedyPlan, "gains", gains)
    monkeypatch.setitem(plan.__dict__, "rollout_samples", samples)
    learning = PolicyIteration(quest[0], quest[1].plan, QUICK)
    begun = learning.begin(np.random.default_rng(0))
    guiding = quest[1].plan.initializer(KEY, {}, None)
    jax.eval_shape(learning._iterated, begun, KEY, guiding, Way(np.float32(0.0)))
    assert set(seen) == {samples}


def iterated(iteration, learner, noop, step, number=1):
    key = jax.random.fold_in(KEY, number)
    return iteration.iterate(learner, key, noop, Way(np.float32(step), np.array(False)))


def test_what_pays_only_together_is_found(iteration, begun, noop):
    learner, shown = begun
    # the guide does nothing
    assert not np.any(shown.returns[:32])
    returns = []
    for number in range(1, 60):
        learner, shown = iterated(iteration, learner, noop, 3e-3, number)
        assert float(shown.mean_return) == pytest.approx(float(np.mean(shown.returns[:32])))
        returns.append(float(shown.mean_return))
        assert bool(shown.is_finite)
    assert 0.8 * MOST < np.mean(returns[-5:]) <= MOST


def test_the_same_keys_give_the_same_value(iteration, begun, noop):
    first, second = (iterated(iteration, begun[0], noop, 3e-3)[0] for _ in range(2))
    assert_same_bits(first.weights, second.weights)
    assert np.any(first.weights != begun[0].weights)


def test_what_is_not_finite_is_not_learnt(iteration, begun, noop):
    after, shown = iterated(iteration, begun[0], noop, np.inf)
    assert not bool(shown.is_finite)
    assert_same_bits(after, begun[0])


def test_states_after_the_end_may_be_no_numbers():
    # 0 / 0 once the door is open, where the episode has ended
    problem = problem_from(
        """domain doors {
    pvariables {
        light : { state-fluent, real, default = 1.0 };
        open : { state-fluent, bool, default = false };
        turn : { action-fluent, bool, default = false };
    };
    cpfs { light' = (0 * light) / (1 - open); open' = open | (turn ^ Bernoulli(0.5)); };
    reward = turn - 0.1;
    termination { open; };
}
non-fluents n { domain = doors; }
instance inst {
    domain = doors; non-fluents = n; max-nondef-actions = 1; horizon = 6; discount = 1.0;
}"""
    )
    config = auto_preset("doors").without_section("Search")
    played, guide = (build_planner(problem, each).planner for each in (greedy(config), config))
    doing_nothing = guide.plan.initializer(KEY, {}, None)
    doors = PolicyIteration(played, guide.plan, QUICK)
    way = Way(np.float32(3e-3), is_first=np.array(True))
    learner, shown = doors.iterate(doors.begin(np.random.default_rng(0)), KEY, doing_nothing, way)
    assert bool(shown.is_finite)
    learner, shown = iterated(doors, learner, doing_nothing, 3e-3)
    assert bool(shown.is_finite)
    assert np.isfinite(learner.weights).all()


def test_the_latest_rollouts_are_kept(iteration, begun, noop):
    kept = begun[0].kept
    # the first ones are all there is
    for each in kept.targets[1:]:
        np.testing.assert_array_equal(each, kept.targets[0])
    learner, _ = iterated(iteration, begun[0], noop, 3e-3)
    np.testing.assert_array_equal(learner.kept.targets[:-1], kept.targets[1:])
    assert np.any(learner.kept.targets[-1] != kept.targets[-1])
    # in half of the rollouts a bool is decided at random now and then, which is not learnt from
    counts = np.asarray(learner.kept.counts[-1])
    assert counts[:32].all()
    assert 0.8 < counts[32:].mean() < 1.0


def test_without_a_step_nothing_is_tried_or_fitted(iteration, begun, noop):
    learner, shown = iterated(iteration, begun[0], noop, 0.0)
    assert_same_bits(learner.weights, begun[0].weights)
    assert_same_bits(learner.moments, begun[0].moments)
    # all rollouts are those of the policy
    assert np.all(learner.kept.counts[-1])
    halves = np.split(np.asarray(shown.returns), 2)
    assert np.mean(halves[0]) == pytest.approx(np.mean(halves[1]), abs=1.0)


def test_targets_have_mean_zero_at_each_step(begun):
    kept = begun[0].kept
    means = np.sum(kept.targets[0] * kept.counts[0], axis=0)
    np.testing.assert_allclose(means, 0.0, atol=1e-3)
    spread = np.sqrt(np.mean(np.square(kept.targets[0])))
    assert float(begun[0].scale) == pytest.approx(spread, rel=1e-3)


def test_the_policy_is_in_the_units_of_the_rewards(quest, iteration, begun):
    learner, values = begun[0], quest[0].plan.values
    state = {name: np.asarray(states[0, 0, 3]) for name, states in learner.kept.states.items()}
    inputs = values.inputs(state)
    policy = iteration.policy(learner)
    found = float(values.value(policy, inputs, 3))
    scaled = float(values.value(iteration.policy(learner._replace(scale=1.0)), inputs, 3))
    assert found == pytest.approx(scaled * float(learner.scale), rel=1e-4)
    assert scaled != 0.0


def test_the_policy_knows_what_is_usual_at_each_step(iteration, begun):
    np.testing.assert_array_equal(iteration.policy(begun[0])["levels"], begun[0].times)
    assert np.any(begun[0].times)


def test_a_pit_is_learnt_to_be_avoided():
    # deep pays more, and after it nothing may be done any more; in the last step that is no harm
    problem = toy("pit", RISK="1.0", REST="0.0", FALLEN="false", DISCOUNT="1.0")
    config = auto_preset("pit").without_section("Search")
    planner = build_planner(problem, greedy(config)).planner
    guide = build_planner(problem, config).planner.plan
    iteration = PolicyIteration(planner, guide, QUICK)
    noop = guide.initializer(KEY, {}, None)
    way = Way(np.float32(3e-3), is_first=np.array(True))
    learner, shown = iteration.iterate(iteration.begin(np.random.default_rng(0)), KEY, noop, way)
    # the guide falls at once, as the first legal change of the no-op is deep
    np.testing.assert_allclose(shown.of_policy, lost_worth(3 / 4))
    for number in range(1, 40):
        learner, shown = iterated(iteration, learner, noop, 3e-3, number)
    np.testing.assert_allclose(shown.of_policy, 2.0 + 2.0 + 2.0 + 5.0)
