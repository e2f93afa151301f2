"""Episodes side by side on the simulator return what the environment's do, of all policies."""

import jax
import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.couriers import courier
from helpers.lakes import preset
from helpers.problems import make_plan, make_planner, shipped, tiny_files
from helpers.toys import problem_from, toy
from helpers.vans import vans

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.policy.formula import FormulaReplicas
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.side_by_side import BatchReplicas, DistinctStates
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment

MEMORY = {"observations": [1.0, 3.0], "actions": [2.0]}
# a wheel that turns by chance, as often as it is pushed; pushing at a rim is illegal, and so is
# doing nothing there
RIM = """
domain rim {
    pvariables {
        at : { state-fluent, int, default = 0 };
        push : { action-fluent, bool, default = false };
        hold : { action-fluent, bool, default = false };
    };
    cpfs { at' = if (hold) then 0 else at + push * Bernoulli(0.5); };
    reward = at - 0.5 * push;
    action-preconditions { at >= 2 => ~push; at >= 2 => hold; };
}
non-fluents nf { domain = rim; }
instance one {
    domain = rim; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 9; discount = 0.9;
}
"""


def feedback(problem, **arguments):
    """A feedback policy whose weights are all drawn."""
    config = preset(1.0).without_section("Search").with_policy_arguments(**arguments)
    planner = build_planner(problem, config).planner
    random = np.random.default_rng(2)
    params = jax.tree.map(
        lambda leaf: (0.03 * random.normal(size=np.shape(leaf))).astype(np.float32),
        planner.plan.noop(0),
    )
    return Policy(problem, config, params, {}, seed=7, compiled=Compiled(planner))


def straight_line(problem):
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"))
    key, hyperparams = jax.random.PRNGKey(0), unit_hyperparams(planner)
    params = planner.plan.initializer(key, hyperparams, planner.test_compiled.init_values)
    config = preset(1.0).with_values("Planner", method="JaxStraightLinePlan", method_kwargs={})
    return Policy(problem, config, params, hyperparams, 0, compiled=Compiled(planner))


def both(policy, episodes, few, seed=3):
    """The evaluation side by side, and on the environment."""
    assert policy.side_by_side(1, 0) is not None
    env = make_environment(policy.problem)
    return policy.evaluate(episodes=episodes, seed=seed), evaluate(env, policy, few, seed)


def agree(here, there):
    """Whether two means are within four standard errors."""
    error = np.hypot(here.std / len(here.returns) ** 0.5, there.std / len(there.returns) ** 0.5)
    assert error > 0.0
    assert abs(here.mean - there.mean) < 4.0 * error


@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (lambda: feedback(toy("drift"), memory=MEMORY), FormulaReplicas),
        (lambda: feedback(vans(), memory=MEMORY), FormulaReplicas),
        (lambda: straight_line(toy("drift")), BatchReplicas),
    ],
    ids=["memory", "objects", "straight line"],
)
def test_where_nothing_is_random_returns_are_equal(make, kind):
    policy = make()
    assert type(policy.replicated()) is kind
    here, there = both(policy, 5, 1)
    np.testing.assert_allclose(here.returns, np.repeat(there.returns, 5), rtol=1e-6)
    assert here.lengths.tolist() == [policy.problem.horizon] * 5
    assert here.illegal_actions == 5 * there.illegal_actions


def test_feedback_where_states_are_drawn(tmp_path):
    policy = feedback(load_problem(*tiny_files(tmp_path, horizon=6, spread=0.5)))
    here, there = both(policy, 1000, 100)
    agree(here, there)
    again = policy.evaluate(episodes=1000, seed=3)
    np.testing.assert_array_equal(again.returns, here.returns)
    assert not np.array_equal(policy.evaluate(episodes=1000, seed=4).returns, here.returns)


def test_feedback_with_relations_of_objects():
    agree(*both(feedback(shipped("reservoir15", 10), distant=True), 500, 30))


def test_a_straight_line_plan_where_states_are_drawn(tmp_path):
    agree(*both(straight_line(load_problem(*tiny_files(tmp_path, spread=0.5))), 1000, 100))


def test_a_table(tmp_path):
    policy = find_optimum(toys.walk(tmp_path, 4), 30).policy(seed=5)
    assert type(policy.replicated()) is DistinctStates
    here, there = both(policy, 1000, 100)
    agree(here, there)
    expected = policy.optimum.value
    assert abs(here.mean - expected) < 4.0 * here.std / 1000**0.5


def test_relaxed_plans():
    policy = RelaxedPlanPolicy(courier(), PlanRule(), Simulated(9.0, 0.5, 16), seed=3)
    here, there = both(policy, 200, 40)
    if there.std > 0.0:
        agree(here, there)
    else:
        np.testing.assert_allclose(here.returns, there.mean)


class Pushing(PolicyAgent):
    """Pushes at every step, as a plan of bools does, and hears what was played."""

    def __init__(self, problem):
        self.problem, self.heard = problem, []

    def __call__(self, step, observation):
        return {"push": True, "hold": False}

    def replicated(self):
        return BatchReplicas(self.batch, self.heard.append, self.problem.model)


def test_an_illegal_action_is_replaced_in_its_replica_alone():
    policy = Pushing(problem_from(RIM))
    here, there = both(policy, 1000, 200)
    policy.heard.clear()
    agree(here, there)
    for name in ("illegal_actions", "fallback_actions"):
        each = [getattr(e, name) / len(e.returns) for e in (here, there)]
        assert each[0] > 0.5
        assert each[0] == pytest.approx(each[1], rel=0.1)
    policy.evaluate(episodes=100, seed=3)
    played = np.stack([each["hold"] for each in policy.heard])
    assert played.any()
    assert not played.all()


def test_a_policy_of_one_episode_plays_one_after_the_other(tmp_path):
    class Counting(Pushing):
        def replicated(self):
            return None

    policy = Counting(problem_from(RIM))
    found = policy.evaluate(episodes=3, seed=2)
    theirs = evaluate(make_environment(policy.problem), policy, 3, 2)
    np.testing.assert_array_equal(found.returns, theirs.returns)


def test_an_error_of_the_environment_is_one_line():
    text = RIM.replace("Bernoulli(0.5)", "Bernoulli(0.7 + at)").replace("at >= 2", "at >= 9")
    with pytest.raises(InputError, match=r"the environment fails in \d+ of 20 episodes"):
        Pushing(problem_from(text)).evaluate(episodes=20)
