"""A vote of the particles: what most of them would do, and never what hangs on the clock."""

import dataclasses
import math

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.tiger import listener
from helpers.toys import toy
from helpers.umbrella import NOTHING_SHOWN, careless, pattering, voting, wet

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy import action_voting
from mdpo_rddl.policy.action_voting import ActionVoting
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.policy.lookahead.belief import believing
from mdpo_rddl.policy.lookahead.table_lookup import TableLookup
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.underlying import underlying_mdp

HEARD = [True, True, False, False, True, False, False, False, True, True, False, True]


def taken(policy, heard=HEARD):
    """What is taken at each step."""
    shown = [NOTHING_SHOWN, *map(pattering, heard)]
    return [bool(policy(step, each)["take"]) for step, each in enumerate(shown)]


def test_the_umbrella_is_taken_where_rain_is_likely():
    likely = wet(HEARD)
    clear = [abs(each - 0.5) > 0.1 for each in likely]
    assert sum(clear) > 8
    chosen = taken(voting())
    assert {each > 0.5 for each, is_clear in zip(likely, clear, strict=True) if is_clear} == {
        True,
        False,
    }
    for each, is_taken, is_clear in zip(likely, chosen, clear, strict=True):
        assert not is_clear or is_taken == (each > 0.5)


def test_the_vote_pays_and_does_not_hang_on_the_clock():
    env = make_environment(toy("umbrella"))
    first, again, alone = (
        evaluate(env, policy, 10, 0).returns for policy in (voting(), voting(), careless())
    )
    assert first.tolist() == again.tolist()
    assert np.mean(first) > np.mean(alone) + 3.0


def test_episodes_side_by_side_are_those_one_after_the_other():
    policy, others = voting(), [not each for each in HEARD]
    alone = [taken(policy, heard) for heard in (HEARD, others)]
    policy.reset()
    side = []
    for step in range(len(HEARD) + 1):
        both = [heard[step - 1] for heard in (HEARD, others)] if step else [None, None]
        side.append(policy.batch(step, {"patter": np.array(both)})["take"])
    assert np.stack(side, axis=1).tolist() == alone
    with pytest.raises(InputError, match=r"there are 3 observations at step 13, and 2 at the one"):
        policy.batch(13, {"patter": np.zeros(3, bool)})
    # a step that follows none begins anew, as for a policy that remembers
    assert policy.batch(7, {"patter": np.zeros(3, bool)})["take"].shape == (3,)


def test_a_step_that_is_asked_for_again_is_the_same_decision():
    policy = voting()
    once = taken(policy, HEARD[:3])
    assert [bool(policy(3, pattering(HEARD[2]))["take"]) for _ in range(2)] == 2 * once[-1:]
    policy.reset()
    assert taken(policy, HEARD[:3]) == once


def test_the_belief_follows_what_was_played():
    solution = find_optimum(underlying_mdp(toy("tiger")), 60.0)
    policy = dataclasses.replace(
        listener(), saved_underlying=solution.policy().to_saved(), votes=True
    )
    listening = {"open-left": np.bool_(False), "open-right": np.bool_(False)}

    def left(actions):
        """Of the particles, after a growl from the left and so many more."""
        policy.reset()
        policy(0, {"growl-left": np.array(None)})
        policy.was_played(actions)
        for step in (1, 2, 3):
            policy(step, {"growl-left": np.bool_(True)})
            policy.was_played(actions)
        return float(np.mean(policy._play.belief.particles["is-left"]))

    # three growls in one place, where nobody has opened a door
    assert left(listening) > 0.97
    opened = {"open-left": np.bool_(True), "open-right": np.bool_(False)}
    assert left(opened) == pytest.approx(0.85, abs=0.06)


def test_it_is_saved_and_says_what_it_is(tmp_path):
    path, policy = tmp_path / "policy", voting()
    policy.save(path)
    again = restored(load_policy(path), toy("umbrella"), str(path))
    assert again.votes
    assert taken(again) == taken(policy)
    assert not again.explain().equations
    assert "vote" in again.explain().note
    assert "vote over a belief" in again._repr_html_()
    assert repr(again).startswith("<Policy for i: vote over a belief")
    assert (careless().vote, careless().votes) == (None, False)


def test_who_thinks_on_from_a_vote_uses_its_filter_again(monkeypatch):
    monkeypatch.setattr(action_voting, "_PARTICLES", 512)
    policy = dataclasses.replace(voting())
    vote = policy.vote
    believer = believing(policy, 1.0, math.inf, Ticking(0.001))
    assert believer.particles == vote.particles == 512
    # none is compiled for another number of particles
    before = vote.filter.advance._cache_size()
    belief = believer.believe(0, NOTHING_SHOWN)
    believer.played(belief, believer(0, belief))
    believer.believe(1, pattering(True))
    assert vote.filter.advance._cache_size() == before == 1
    assert believing(careless(), 1.0, math.inf, Ticking(0.001)).particles > vote.particles


def test_what_is_compiled_is_kept_where_only_candidates_are_new():
    first = {"became_incumbent": True, "mean_return": 3.0, "candidate": "vote", "arm": "voting"}
    policy = voting().with_candidates([first])
    assert policy._play is voting()._play
    assert policy.candidates == (first,)
    assert taken(policy) == taken(voting())


def test_a_table_that_cannot_be_looked_up_is_told_in_one_line(monkeypatch):
    def refused(self, table):
        raise ValueError("the table is too large")

    monkeypatch.setattr(TableLookup, "__init__", refused)
    with pytest.raises(InputError, match=r"policy cannot be played: the table is too large"):
        ActionVoting(careless(), voting().underlying)
