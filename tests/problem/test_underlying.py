"""The underlying MDP: the same states, actions and laws, and no observations."""

import numpy as np
from helpers.toys import problem_from, toy

from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.underlying import underlying_mdp

ODD = """domain odd {
    requirements = { partially-observed };
    types { place : object; };
    pvariables {
        HEARS(place) : { non-fluent, real, default = 0.9 };
        sound : { state-fluent, bool, default = false };
        at(place) : { state-fluent, bool, default = false };
        heard-at(place) : { observ-fluent, bool };  // heard-at(?p) = nothing;
        at-heard : { state-fluent, bool, default = false };
        heard  :  { observ-fluent,
                    real };
        go(place) : { action-fluent, bool, default = false };
    };
    cpfs {
        at'(?p) = go(?p) | at(?p);
        // sound and at-heard only look like observations
        at-heard' = exists_{?p : place} [at(?p)];
        sound' = at-heard;
        heard-at(?p) = if (at'(?p) == true)
            then Bernoulli(HEARS(?p))
            else false;
        heard = sum_{?p : place} [at'(?p)];
    };
    reward = at-heard + sound;
}
non-fluents nf { domain = odd; objects { place : {a, b}; }; non-fluents { HEARS(b) = 0.5; }; }
instance i {
    domain = odd; non-fluents = nf; max-nondef-actions = 2; horizon = 4; discount = 0.9;
}
"""


def test_observations_are_left_out_and_nothing_else():
    problem = problem_from(ODD)
    assert set(problem.model.observ_fluents) == {"heard-at", "heard"}
    seen = underlying_mdp(problem)
    model = seen.model
    assert not model.observ_fluents
    assert set(model.state_fluents) == {"sound", "at", "at-heard"}
    assert set(model.cpfs) == {"sound'", "at'", "at-heard'"}
    assert (seen.horizon, model.discount, seen.label) == (4, 0.9, problem.label)
    assert seen.digest != problem.digest
    # of what is observed it is itself again
    assert underlying_mdp(seen).digest == seen.digest


def test_a_horizon_of_the_users_own_is_kept():
    assert underlying_mdp(problem_from(ODD, horizon=9)).horizon == 9


def test_whoever_plays_it_sees_the_state():
    env = make_environment(underlying_mdp(toy("tiger")))
    state, _ = env.reset(seed=0)
    assert set(state) == {"begun", "is-left"}
    following, reward, *_ = env.step({"open-left": np.bool_(True), "open-right": np.bool_(False)})
    assert (bool(following["begun"]), float(reward)) == (True, 0.0)
