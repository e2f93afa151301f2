"""Thinking with a policy of the underlying MDP: who sees the tiger opens the other door."""

import dataclasses
import functools

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.tiger import NOTHING_SHOWN, listener
from helpers.toys import toy

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.policy.lookahead import choice as choosing
from mdpo_rddl.policy.lookahead import qmdp
from mdpo_rddl.policy.lookahead.belief import Believer
from mdpo_rddl.policy.lookahead.choice import choose
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.qmdp import try_qmdp
from mdpo_rddl.policy.lookahead.sequences import Sequences
from mdpo_rddl.policy.lookahead.simulator import NARROW
from mdpo_rddl.policy.lookahead.trials import NO_TIME
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.underlying import underlying_mdp

SECONDS = 1.0


@functools.cache
def seeing():
    """The listener, with the optimum of whoever sees the tiger: 10 at each step but the first."""
    solution = find_optimum(underlying_mdp(toy("tiger")), 60.0)
    assert solution.value == pytest.approx(110.0)
    return dataclasses.replace(listener(), saved_underlying=solution.policy().to_saved())


@pytest.fixture(scope="module")
def believer():
    found = Believer(seeing(), Ticking(0.01))
    found.prepare(SECONDS)
    return found


def gaining(*gains):
    """Returns of both in episodes in which the first gains so much."""
    return np.array([(gain - 7.0, -7.0) for gain in gains])


def tried(believer, methods, until=1000.0):
    components = Components.of(believer.planner)
    applying = [method for method in methods if method.applies(components)]
    return try_qmdp(believer, applying, (SECONDS, until), Ticking(0.01))


@pytest.mark.long
def test_doors_are_opened_and_the_trial_says_what_that_gains(believer):
    thinker, (trial,) = tried(believer, [Sequences(), FirstActions(), Coordinate()])
    assert (thinker.label, trial.method) == ("first actions, QMDP", "first actions, QMDP")
    assert trial.pays
    alone = -11.0
    returns = evaluate(make_environment(thinker.problem), thinker, 20, 0).returns
    assert returns.mean() > alone + 10.0
    # an episode's gain over its twelve decisions
    assert 12.0 * trial.mean == pytest.approx(returns.mean() - alone, abs=25.0)
    assert trial.states % 12 == 0
    # what is saved is the policy, which can be given time again
    assert thinker.base.underlying is seeing().underlying


@pytest.mark.long
def test_the_particles_go_on_as_whoever_sees_the_tiger(believer):
    thinker, _ = tried(believer, [FirstActions()])
    simulator, believing = thinker._simulator, thinker.base
    belief = believing.believe(0, NOTHING_SHOWN)
    listening, opening = np.zeros((2, 1, 2), np.float32)
    opening[0, 0] = 1.0
    # the first step pays nothing and leaves it open where the tiger is: 11 steps of 10 are left
    gains = simulator.gains(NARROW, belief, 0, np.stack([listening, opening]), seed=0)
    assert gains.mean() == pytest.approx(0.0, abs=1e-3)
    size = simulator._sizes[NARROW]
    returns = simulator._returns(
        NARROW, belief, 0, np.zeros((size.candidates, 1, 2), np.float32), 0
    )
    assert returns == pytest.approx(np.full_like(returns, 110.0))
    # the policy itself still listens
    assert not any(np.any(value) for value in believing(0, belief).values())


def test_episodes_of_two_believers_do_not_meet(believer):
    other = believer.continued_by(seeing())
    belief = believer.believe(0, NOTHING_SHOWN)
    believer.played(belief, {"open-left": np.bool_(True), "open-right": np.bool_(False)})
    assert other._now is None
    believer.believe(1, {"growl-left": np.bool_(True)})
    assert not np.any(other.believe(0, NOTHING_SHOWN).root.memory["last open-left"])


def test_without_such_a_policy_or_method_nothing_is_tried(believer):
    assert tried(believer, [Sequences()]) == (None, [])
    plain = Believer(listener(), Ticking(0.01))
    assert tried(plain, [FirstActions()]) == (None, [])


def test_without_time_nothing_is_played(believer):
    thinker, (trial,) = tried(believer, [FirstActions()], until=0.0)
    assert (thinker, trial.note, trial.pays) == (None, NO_TIME, False)


def test_a_policy_that_does_not_fit_is_told_and_left_out(believer, monkeypatch, caplog):
    def refused(self):
        raise InputError("it is of\nanother problem")

    monkeypatch.setattr(Policy, "underlying", property(refused))
    assert tried(believer, [FirstActions()]) == (None, [])
    assert "no policy of the underlying MDP: it is of another problem" in caplog.text


@pytest.mark.long
def test_it_is_chosen_where_it_pays():
    choice = choose(seeing(), SECONDS, clock=Ticking(0.01))
    assert choice.policy is not None
    assert choice.policy.label == "first actions, QMDP"
    assert [trial.pays for trial in choice.trials] == [True]


def test_the_other_methods_are_tried_where_it_does_not_pay(monkeypatch):
    monkeypatch.setattr(choosing, "_methods", lambda: [FirstActions()])
    monkeypatch.setattr(qmdp, "paired_returns", lambda *_: gaining(1.0, -1.0, 1.0, -1.5))
    choice = choose(seeing(), SECONDS, clock=Ticking(0.01))
    first, second = choice.trials
    assert (first.method, first.pays) == ("first actions, QMDP", False)
    # an episode has twelve decisions
    assert first.mean == pytest.approx(-0.125 / 12.0)
    assert (second.method, second.pays) == ("first actions", True)
    assert choice.policy is not None
    assert choice.policy.label == "first actions"


def test_half_an_error_is_gain_enough(believer, monkeypatch):
    for gains, pays in (([3.0, -1.0, 2.0, -1.0], True), ([1.0, -1.0, 1.0, -0.5], False)):
        monkeypatch.setattr(qmdp, "paired_returns", lambda *_, gains=gains: gaining(*gains))
        thinker, (trial,) = tried(believer, [FirstActions()])
        assert 0.0 < trial.mean < trial.error
        assert (trial.pays, thinker is not None) == (pays, pays)


def test_it_is_saved_with_the_policy(tmp_path):
    path = tmp_path / "policy"
    seeing().save(path)
    policy = restored(load_policy(path), toy("tiger"), str(path))
    assert policy.underlying.optimum.value == seeing().underlying.optimum.value
    path.unlink()
    policy.save(path)
    again = restored(load_policy(path), toy("tiger"), str(path))
    assert again.underlying.table.action.tolist() == policy.underlying.table.action.tolist()


@pytest.mark.long
def test_who_votes_thinks_on_from_the_vote():
    voter = dataclasses.replace(seeing(), votes=True)
    believer = Believer(voter, Ticking(0.01))
    believer.prepare(SECONDS)
    belief = believer.believe(0, NOTHING_SHOWN)
    believer.played(belief, voter.vote.elect(0, belief.root.particles))
    heard = believer.believe(1, {"growl-left": np.bool_(True)})
    # the tiger is on the left: the listener's own action would open nothing
    assert bool(believer(1, heard)["open-right"])
    # only what goes on with the underlying MDP's policy is tried
    choice = choose(voter, SECONDS, clock=Ticking(0.01))
    assert [trial.method for trial in choice.trials] == ["first actions, QMDP"]
