"""Trials on a problem that shows its state through observations, and nothing before step 1."""

import numpy as np
import pytest

from mdpo_rddl.ipc.noop_player import NoopPlayer
from mdpo_rddl.ipc.random_player import RandomPlayer
from mdpo_rddl.ipc.trial import play
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment
from mdpo_rddl.problem.observation import is_observed

DOMAIN = """
domain hidden {
    types { unit : object; colour : {@red, @green}; };
    pvariables {
        x(unit) : { state-fluent, real, default = 0.5 };
        push(unit) : { action-fluent, real, default = 0.0 };
        stop : { action-fluent, bool, default = false };
        seen(unit) : { observ-fluent, real };
        far : { observ-fluent, bool };
        shade(unit) : { observ-fluent, colour };
    };
    cpfs {
        x'(?u) = x(?u) + push(?u) + 1.0;
        seen(?u) = 2.0 * x'(?u);
        far = (exists_{?u : unit} [x'(?u) > 2.0]);
        shade(?u) = if (x'(?u) > 2.0) then @green else @red;
    };
    reward = sum_{?u : unit} [x(?u)];
    action-preconditions { forall_{?u : unit} [push(?u) >= -0.25 ^ push(?u) <= 0.25]; };
}
"""
INSTANCE = """
non-fluents nf { domain = hidden; objects { unit : {a, b}; }; }
instance one {
    domain = hidden; non-fluents = nf; max-nondef-actions = pos-inf; horizon = HORIZON;
    discount = 1.0;
}
"""


def hidden_problem(folder, horizon=3):
    (folder / "d.rddl").write_text(DOMAIN)
    (folder / "i.rddl").write_text(INSTANCE.replace("HORIZON", str(horizon)))
    return load_problem(str(folder / "d.rddl"), str(folder / "i.rddl"))


def written_trace(problem, player, folder):
    player.prepare(problem, 1.0, 0)
    env, rng = make_environment(problem), np.random.default_rng(0)
    result, trace = play(env, player, 7, rng, lenient=False)
    assert (result.status, result.cause, result.violations) == ("ok", "", 0)
    trace.write(folder / "trial.npz")
    with np.load(folder / "trial.npz") as file:
        return result, dict(file)


def test_nothing_is_observed_before_the_first_step_and_everything_after(tmp_path):
    env = make_environment(hidden_problem(tmp_path))
    first, _ = env.reset(seed=0)
    assert set(first) == {"seen", "far", "shade"}
    assert not any(map(is_observed, first.values()))
    assert not is_observed(None)
    second, *_ = env.step({})
    assert all(map(is_observed, second.values()))


def test_the_trace_of_a_partially_observed_trial_is_written_and_says_what_was_not_seen(tmp_path):
    result, trace = written_trace(hidden_problem(tmp_path), NoopPlayer(), tmp_path)
    assert result.total == 1.0 + 3.0 + 5.0
    nan = np.nan
    np.testing.assert_array_equal(trace["state/seen"], [[nan, nan], [3.0, 3.0], [5.0, 5.0]])
    np.testing.assert_array_equal(trace["state/far"], [[nan], [0.0], [1.0]])
    assert trace["state/shade"].tolist() == [["", ""], ["red"] * 2, ["green"] * 2]
    np.testing.assert_array_equal(trace["reward"], [1.0, 3.0, 5.0])


def test_a_trial_that_ends_before_anything_is_observed_has_a_trace_too(tmp_path):
    _, trace = written_trace(hidden_problem(tmp_path, horizon=1), NoopPlayer(), tmp_path)
    assert {name: trace[name].shape for name in trace if name.startswith("state/")} == {
        "state/seen": (1,),
        "state/far": (1,),
        "state/shade": (1,),
    }
    assert np.isnan(trace["state/seen"]).all()


@pytest.mark.parametrize("horizon", [1, 3])
def test_random_actions_are_legal_where_the_state_is_hidden(tmp_path, horizon):
    _, trace = written_trace(hidden_problem(tmp_path, horizon), RandomPlayer(), tmp_path)
    assert trace["action/push"].shape == (horizon, 2)
    assert np.all(np.abs(trace["action/push"]) <= 0.25)


def test_an_evaluation_shows_the_policy_the_observations_alone(tmp_path):
    shown = []

    def policy(step, state):
        shown.append({name: is_observed(value) for name, value in state.items()})
        return {}

    found = evaluate(make_environment(hidden_problem(tmp_path)), policy, 2, 0)
    np.testing.assert_array_equal(found.returns, 9.0)
    one = [dict.fromkeys(("seen", "far", "shade"), step > 0) for step in range(3)]
    assert shown == one + one
