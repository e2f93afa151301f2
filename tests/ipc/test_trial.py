"""One trial of a run: what is played, what counts as illegal, what is recorded."""

import numpy as np
import pytest
from helpers import toy_contest
from helpers.problems import tiny_files

from mdpo_rddl.ipc.referee import ContestReferee, IllegalActionError, ViolationError
from mdpo_rddl.ipc.traces import Trace
from mdpo_rddl.ipc.trial import play
from mdpo_rddl.problem.evaluation import episode_seeds, evaluate
from mdpo_rddl.problem.load import load_problem, make_environment


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return load_problem(*tiny_files(tmp_path_factory.mktemp("tiny"), horizon=3, spread=0.3))


def played(problem, planner, lenient=False, seed=7):
    planner.prepare(problem, 1.0, 0)
    return play(make_environment(problem), planner, seed, np.random.default_rng(0), lenient)


class Plays(toy_contest.Steady):
    """Always the same."""

    def __init__(self, **actions):
        self.actions = actions

    def act(self, step, state, rng):
        return self.actions


def test_the_return_is_that_of_the_ordinary_loop(problem):
    planner = toy_contest.Steady()
    (seed,) = episode_seeds(3, 1)
    result, _ = played(problem, planner, seed=seed)
    assert (result.status, result.cause, result.steps, result.violations) == ("ok", "", 3, 0)

    def policy(step, state):
        return planner.act(step, state, np.random.default_rng(0))

    assert result.total == evaluate(make_environment(problem), policy, 1, 3).returns[0]


def test_the_trace_holds_each_step(problem, tmp_path):
    result, trace = played(problem, toy_contest.Exact())
    trace.write(tmp_path / "new" / "trial.npz")
    with np.load(tmp_path / "new" / "trial.npz") as file:
        assert set(file) == {"reward", "state/x", "action/push"}
        x, push, reward = file["state/x"], file["action/push"], file["reward"]
    assert x.shape == push.shape == (3, 2)
    np.testing.assert_array_equal(x[0], 0.0)
    np.testing.assert_allclose(push, 0.5 - x)
    np.testing.assert_allclose(reward, -np.sum((x - 0.5) ** 2, axis=1))
    assert result.total == pytest.approx(reward.sum())


def test_what_is_not_observed_before_the_first_step_is_not_a_number_in_the_trace():
    trace = Trace()
    for seen in (None, np.array([1.0, 2.0]), np.array([3.0, 4.0])):
        trace.add({"x": seen}, {"push": np.zeros(2)}, 0.0)
    expected = [[np.nan, np.nan], [1.0, 2.0], [3.0, 4.0]]
    np.testing.assert_array_equal(trace.arrays()["state/x"], expected)


def test_a_broken_precondition_ends_a_strict_trial(problem):
    result, _ = played(problem, toy_contest.TooFar())
    cause = "step 1: a precondition of the domain does not hold"
    assert (result.status, result.cause) == ("illegal", cause)
    assert (result.steps, result.violations) == (1, 1)


def test_a_lenient_trial_goes_on_and_counts(problem):
    result, _ = played(problem, toy_contest.TooFar(), lenient=True)
    assert (result.status, result.steps, result.violations) == ("ok", 3, 1)
    assert np.isfinite(result.total)


@pytest.mark.parametrize(
    ("actions", "cause"),
    [
        ({"pull": np.zeros(2)}, "<pull> is not a valid action-fluent"),
        ({"push": np.zeros(3)}, "must be of shape (2,), got array of shape (3,)"),
        ({"push": np.array([0.0, np.nan])}, "push is not finite"),
        ({"push": np.array(["a", "b"])}, ""),
    ],
)
def test_what_the_environment_cannot_take_is_illegal_even_in_a_lenient_trial(
    problem, actions, cause
):
    result, _ = played(problem, Plays(**actions), lenient=True)
    assert result.status == "illegal"
    assert cause in result.cause
    assert "\n" not in result.cause
    assert result.steps == 0


def test_a_planner_that_returns_no_actions_at_all_fails_its_trial(problem):
    result, _ = played(problem, Plays())
    assert result.status == "ok"
    planner = Plays()
    planner.actions = None
    result, _ = played(problem, planner)
    assert result.status == "illegal"


def test_an_error_of_the_planner_fails_the_trial_and_is_named_in_one_line(problem):
    planner = toy_contest.Raising()
    planner.prepare(problem, 1.0, 0)
    planner.trial = 0
    env, rng = make_environment(problem), np.random.default_rng(0)
    result, _ = play(env, planner, 7, rng, lenient=False)
    assert (result.status, result.cause) == ("error", "step 0: RuntimeError: no plan for this")
    result, _ = play(env, planner, 7, rng, lenient=False)
    assert result.status == "ok"


@pytest.mark.parametrize(("reward", "total"), [(float("nan"), "nan"), (-1e200, "-3e+200")])
def test_a_return_that_has_no_mean_fails_the_trial(problem, monkeypatch, reward, total):
    env = make_environment(problem)
    monkeypatch.setattr(env.sampler, "sample_reward", lambda: reward)
    planner = toy_contest.Exact()
    planner.prepare(problem, 1.0, 0)
    result, _ = play(env, planner, 7, np.random.default_rng(0), lenient=False)
    assert (result.status, result.cause) == ("non-finite", f"the return is {total}")


def test_a_bound_that_32_bit_cannot_hold_is_no_violation(tmp_path):
    domain, instance = tiny_files(tmp_path)
    path = tmp_path / "d.rddl"
    path.write_text(path.read_text().replace("push(?u) <= 1.0", "push(?u) <= 0.1"))
    env = make_environment(load_problem(domain, instance))
    env.reset(seed=0)
    referee = ContestReferee(env, lenient=True)
    rounded = np.full(2, np.float32(0.1))
    assert np.all(rounded.astype(float) > 0.1)
    verdict = referee.rule({"push": rounded})
    np.testing.assert_array_equal(verdict.actions["push"], 0.1)
    assert not verdict.illegal
    beyond = np.nextafter(np.float32(0.1), np.float32(1.0))
    assert referee.rule({"push": np.array([0.0, beyond])}).illegal
    with pytest.raises(ViolationError):
        ContestReferee(env, lenient=False).rule({"push": np.array([0.0, beyond])})
    with pytest.raises(IllegalActionError):
        referee.rule({"push": np.array([np.inf, 0.0])})
