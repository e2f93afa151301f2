"""What a run keeps of how its policy plays."""

import numpy as np
import pytest
from helpers.tanks import DOMAIN, INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.policy.side_by_side import BatchReplicas
from mdpo_rddl.problem.evaluation import difference, evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.references import many_episodes
from mdpo_rddl.session.report.page.record import read_play
from mdpo_rddl.session.requests import Terms


class Silent:
    def stage(self, name):
        """Nobody listens."""

    def episode(self, done, of):
        """Nobody listens."""


def fill(step, state):
    return {"fill": np.full(2, 0.1)}


def test_the_policy_that_played_last_is_kept_and_the_references_are_played_beside_it(tmp_path):
    problem = problem_from(DOMAIN + INSTANCE, horizon=4)
    terms = Terms(problem, seed=5, episodes=3)
    observed = Observed(terms)
    Evaluator(terms, Silent()).run(lambda step, state: {}, observed)
    found = Evaluator(terms, Silent()).run(fill, observed)
    figures = observed.figures(found.returns)
    noop = evaluate(make_environment(problem), lambda step, state: {}, 100, 5)
    references = figures["references"]
    gain = difference(noop.returns, np.array(references["noop"]["returns"]))
    assert gain[0] < 0.0 < gain[1]
    assert len(references["noop"]["returns"]) > 3
    assert len(set(references["random"]["returns"])) > 3
    assert all(each["simulated"] for each in references.values())
    times = figures["decision_times"]
    assert 0.0 < times["mean"] <= times["max"]
    observed.write(tmp_path)
    plays, seconds = read_play(tmp_path / "trajectories.npz")
    assert seconds.shape == (12,)
    np.testing.assert_array_equal(plays["policy"].values["action", "fill"], np.float32(0.1))
    np.testing.assert_array_equal(plays["noop"].values["action", "fill"], 0.0)
    np.testing.assert_allclose(plays["policy"].rewards.sum(axis=1), found.returns, rtol=1e-5)


class Filling(PolicyAgent):
    """Fills by chance, so that episodes differ, and as a formula on numpy would."""

    problem = problem_from(DOMAIN + INSTANCE, horizon=4)
    lasts = False

    def __call__(self, step, observation):
        return {"fill": np.full(2, 0.1)}

    def replicated(self):
        return None if self.lasts else BatchReplicas(self.batch, lambda actions: None, MODEL)


MODEL = Filling.problem.model


def test_trajectories_are_of_many_episodes_on_the_simulator(tmp_path):
    policy, terms = Filling(), Terms(Filling.problem, seed=5, episodes=3)
    observed = Observed(terms)
    Evaluator(terms, Silent()).run(policy, observed)
    observed.play_side_by_side(policy)
    figures = observed.figures(np.zeros(3))
    observed.write(tmp_path)
    plays, seconds = read_play(tmp_path / "trajectories.npz")
    episodes = figures["simulated_episodes"]
    assert len(plays["policy"].rewards) == episodes > 3
    assert len(plays["noop"].rewards) > 3
    assert seconds.shape == (12,)
    kept = policy.side_by_side(episodes, 5, keep=True)
    np.testing.assert_allclose(
        plays["policy"].rewards.sum(axis=1), kept.evaluation.returns, rtol=1e-5
    )
    np.testing.assert_array_equal(plays["policy"].values["action", "fill"], np.float32(0.1))
    for (kind, name), values in plays["policy"].values.items():
        if kind == "state":
            like = np.moveaxis(kept.trajectories.states[name][:-1], -1, 0)
            np.testing.assert_allclose(values, like, rtol=1e-6)


def test_trajectories_of_one_episode_at_a_time_are_those_of_the_evaluation():
    policy, terms = Filling(), Terms(Filling.problem, seed=5, episodes=3)
    policy.lasts = True
    observed = Observed(terms)
    Evaluator(terms, Silent()).run(policy, observed)
    observed.play_side_by_side(policy)
    assert observed.figures(np.zeros(3))["simulated_episodes"] is None
    assert len(observed.recorder.result().rewards) == 3


def test_many_episodes_are_a_few_where_these_take_long(monkeypatch):
    times = iter([0.0, 0.2, 0.0, 0.1, 0.0, 0.1, 0.0, 0.9])
    monkeypatch.setattr("mdpo_rddl.session.references.time.perf_counter", lambda: next(times))
    asked = []
    many_episodes(asked.append)
    assert asked == [16]
    many_episodes(asked.append)
    assert asked == [16, 16, 128, 1000]


def test_a_policy_that_returns_less_than_random_actions_is_told(caplog):
    problem = problem_from(PUMPED.replace("flow >= 0.0;", "flow >= -1.0; flow <= 1.0;"))
    observed = Observed(Terms(problem, seed=0, episodes=2))
    observed.figures([-9.0, -8.0])
    noop, random = caplog.messages
    assert noop.startswith("the no-op returned more than the policy: 15.00 in ")
    assert noop.endswith(" episodes on the simulator, the policy -8.50")
    assert random.startswith("random actions returned more than the policy: ")


def test_a_play_that_fails_replaces_nothing(tmp_path):
    terms = Terms(problem_from(DOMAIN + INSTANCE, horizon=4), seed=5, episodes=3)
    observed = Observed(terms)
    found = Evaluator(terms, Silent()).run(fill, observed)

    def failing(step, state):
        return {"fill": np.full(2, 1.0 if step < 2 else 1 / 0)}

    with pytest.raises(ZeroDivisionError), observed.replaced() as other:
        Evaluator(terms, Silent()).run(failing, other)
    observed.write(tmp_path)
    plays, seconds = read_play(tmp_path / "trajectories.npz")
    assert seconds.shape == (12,)
    np.testing.assert_allclose(plays["policy"].rewards.sum(axis=1), found.returns, rtol=1e-5)
    with observed.replaced() as other:
        Evaluator(terms, Silent()).run(lambda step, state: {}, other)
    np.testing.assert_array_equal(observed.recorder.result().values["action", "fill"], 0.0)


PUMPED = """
domain pump {
    pvariables {
        depth : { state-fluent, real, default = 5.0 };
        flow : { action-fluent, real, default = 0.0 };
        turns : { action-fluent, int, default = 0 };
    };
    cpfs { depth' = depth + flow; };
    reward = depth;
    action-preconditions { turns >= 0; turns <= 10; flow >= 0.0; };
}
non-fluents nf { domain = pump; }
instance one { domain = pump; non-fluents = nf; horizon = 3; discount = 1.0; }
"""


def warned(problem, actions, caplog):
    terms = Terms(problem, seed=0, episodes=2)
    observed = Observed(terms)
    Evaluator(terms, Silent()).run(lambda step, state: actions, observed)
    observed.figures([1e38, 1e38])  # more than the references
    return caplog.messages


def test_an_unbounded_action_that_is_exploited_is_named(caplog):
    flow, total = warned(problem_from(PUMPED), {"flow": 1e37}, caplog)
    assert flow.startswith("the action flow is played at 1e+37, and no precondition bounds it")
    assert "flow <= ..." in flow
    assert total.startswith("a return of 3e+37 is near the largest number of the compiled model")


def test_large_values_within_a_bound_are_no_exploit(caplog):
    bounded = PUMPED.replace("flow >= 0.0;", "flow >= 0.0; flow <= 20000000.0;")
    assert warned(problem_from(bounded), {"flow": 2e7}, caplog) == []


def test_usual_values_of_an_unbounded_action_are_no_exploit(caplog):
    assert warned(problem_from(PUMPED), {"flow": 900.0}, caplog) == []
