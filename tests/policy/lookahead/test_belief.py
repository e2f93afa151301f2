"""Thinking where the state is not observed: a tiger behind one of two doors."""

import numpy as np
import pytest
from helpers.clocks import Stopped, Ticking
from helpers.mistakes import one_line
from helpers.tiger import NOTHING_SHOWN, listener

from mdpo_rddl.planner.exact.filtering import ParticleFilter
from mdpo_rddl.policy.lookahead import choice as choosing
from mdpo_rddl.policy.lookahead.belief import Believer
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.simulator import NARROW, Simulator
from mdpo_rddl.policy.lookahead.statistics import decision_figures
from mdpo_rddl.policy.lookahead.trials import NO_TIME
from mdpo_rddl.problem.episode import Episode, Verdict
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.requests import Terms

HEARS = 0.85
LISTEN = {"open-left": np.bool_(False), "open-right": np.bool_(False)}


def heard(is_left):
    return {"growl-left": np.bool_(is_left)}


@pytest.fixture(scope="module")
def believing():
    found = Believer(listener(), Ticking(0.01))
    found.prepare(1.0)
    return found


@pytest.fixture(scope="module")
def simulator(believing):
    found = Simulator(believing, depth=1, clock=Ticking(0.01))
    assert found.prepare(believing.believe(0, NOTHING_SHOWN), 1.0)
    return found


def left_after(believing, growls, is_tried=False):
    """The belief after listening at the first step and hearing so."""
    belief = believing.believe(0, NOTHING_SHOWN)
    for step, is_left in enumerate(growls, 1):
        believing.played(belief, LISTEN)
        belief = believing.believe(step, heard(is_left), is_tried)
    return belief


def share_left(belief):
    return float(np.mean(belief.root.particles["is-left"]))


def test_the_belief_is_that_of_bayes(believing):
    odds = HEARS / (1.0 - HEARS)
    for growls, lead in [((1,), 1), ((1, 1), 2), ((1, 0), 0), ((0, 0, 0), -3)]:
        belief = left_after(believing, growls)
        assert share_left(belief) == pytest.approx(odds**lead / (1.0 + odds**lead), abs=0.03)
        assert belief.matches
    # what is opened is drawn anew, and one growl is heard of it
    believing.played(belief, {**LISTEN, "open-left": np.bool_(True)})
    assert share_left(believing.believe(4, heard(True))) == pytest.approx(HEARS, abs=0.03)


def test_a_belief_reads_as_what_is_observed(believing):
    belief = left_after(believing, (1, 0))
    assert dict(belief) == heard(False)
    assert believing.believe(7, belief).root is belief.root
    # asked for again it is the same; what is played at another one changes nothing
    believing.played(dict(belief), {**LISTEN, "open-left": np.bool_(True)})
    again = believing.believe(2, heard(False))
    assert share_left(again) == share_left(belief)
    # a door that is opened at it leads to the next step, not to this one
    believing.played(again, {**LISTEN, "open-left": np.bool_(True)})
    again = believing.believe(2, heard(False))
    assert share_left(again) == share_left(belief)
    # a new episode begins in the initial state
    assert not np.any(believing.believe(0, NOTHING_SHOWN).root.particles["begun"])


def test_the_policy_is_compiled_once_for_what_an_environment_shows():
    policy = Believer(listener.__wrapped__(), Ticking(0.01))
    env = make_environment(policy.problem)
    state = env.reset(seed=0)[0]
    for step in range(3):
        policy(step, policy.believe(step, state))
        state = env.step(LISTEN)[0]
    assert policy.planner.test_policy._cache_size() == 1


def test_the_policy_remembers_what_was_played(believing):
    policy = listener()
    env = make_environment(policy.problem)
    state = env.reset(seed=0)[0]
    policy.reset()
    for step in range(4):
        action = policy(step, state)
        belief = believing.believe(step, state)
        for name, value in policy._play.memory_at(step).items():
            np.testing.assert_array_equal(belief.root.memory[name], value)
        assert {n: bool(v) for n, v in believing(step, belief).items()} == {
            n: bool(v) for n, v in action.items()
        }
        believing.played(belief, action)
        state = env.step(action)[0]
    # it is what was played that counts, not what the policy would have played
    belief = believing.believe(4, heard(True))
    believing.played(belief, {**LISTEN, "open-left": np.bool_(True)})
    memory = believing.believe(5, heard(False)).root.memory
    lasts = [float(memory[f"last {name}"]) for name in ("open-left", "open-right", "growl-left")]
    assert lasts == [1.0, 0.0, 1.0]


def test_doors_are_worth_what_the_belief_says(simulator, believing):
    belief = left_after(believing, (1, 1), is_tried=True)
    listen, left, right = np.zeros((3, 1, 2), np.float32)
    left[0, 0] = right[0, 1] = 1.0
    assert [part.start for part in simulator.components.parts.values()] == [0, 1]
    decided = believing.believe(2, belief)
    for known in (belief, decided):
        is_left = share_left(known)
        candidates = np.stack([listen, left, right])
        calls = [simulator.gains(NARROW, known, 2, candidates, seed) for seed in range(40)]
        gains = np.mean(calls, axis=(0, 2))
        # all rollouts listen afterwards
        worth = [10.0 * p - 100.0 * (1.0 - p) + 1.0 for p in (1.0 - is_left, is_left)]
        np.testing.assert_allclose(gains, worth, atol=1.5)
    # a decision sees other particles than those by which it is measured
    assert share_left(decided) != share_left(belief)


def test_a_door_is_opened_as_soon_as_the_belief_is_worth_it(simulator):
    """Two growls more from one side: 10 p - 100 (1 - p) is -6.5 for one, 6.7 for two."""
    method = FirstActions()
    assert method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 1.0, seed=0, clock=Ticking(0.01))
    several = {"growl-left": np.zeros(2, bool)}
    assert "one episode at a time" in one_line(lambda: thinker.batch(1, several))
    played, lead = [], 0
    for step, is_left in enumerate([None, True, True, False, True, False, False, False]):
        if is_left is not None:
            lead += 1 if is_left else -1
        action = thinker(step, NOTHING_SHOWN if is_left is None else heard(is_left))
        opened = [name for name in LISTEN if bool(action[name])]
        # the door that the tiger is not behind
        assert opened == ([] if abs(lead) < 2 else ["open-right" if lead > 0 else "open-left"])
        played += opened
        lead = 0 if opened else lead
    assert played == ["open-right", "open-left"]
    assert [decision.step for decision in thinker.decisions if decision.left_base] == [2, 6]


def test_what_is_played_instead_of_a_decision_is_taken_in(simulator, believing, monkeypatch):
    """By a referee in an evaluation, and by what makes an agent's actions legal."""
    method = FirstActions()
    assert method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 1.0, seed=0, clock=Ticking(0.01))
    opened, memories = {**LISTEN, "open-left": np.bool_(True)}, []

    class Opening:
        def rule(self, proposal, state=None):
            memories.append(believing._now.root.memory)
            return Verdict(opened, illegal=True, fallback=True)

    env = make_environment(thinker.problem)
    # watched, as in a run, it is told too
    observed = Observed(Terms(thinker.problem, seed=0, episodes=1))
    Episode(env, observed.watch(thinker), Opening()).play(env.reset(seed=0)[0])
    assert len(memories) == env.horizon
    # decisions that were not played are counted as such
    decisions = list(thinker.decisions)
    assert all(decision.replaced for decision in decisions)
    figures = decision_figures(decisions, 1.0, 1)
    assert (figures["replaced"], figures["left_base"]) == (env.horizon, 0)
    assert figures["expected_gain"] == 0.0
    monkeypatch.setattr(thinker, "_moves", Opening())
    thinker.reset()
    for state in (NOTHING_SHOWN, heard(True), heard(True)):
        thinker.sample_action(state)
    lasts = [float(memory["last open-left"]) for memory in memories]
    starts = [0, env.horizon]
    assert lasts == [float(place not in starts) for place in range(len(memories))]
    # the tiger has chosen anew at each step, and one growl is heard of it
    assert share_left(believing._now) == pytest.approx(HEARS, abs=0.03)


def test_a_filter_is_not_compiled_again_where_that_would_end_late(monkeypatch):
    clock = Stopped()

    def measured(_, seen):
        clock.now += 4.0
        return 2.0

    monkeypatch.setattr(Believer, "_measured", measured)
    monkeypatch.setattr(choosing, "_visited", None)
    for until, expected in ((7.9, 4.0), (8.1, 8.0)):
        clock.now = 0.0
        choice = choosing.choose(listener(), 2.0, until, clock)
        assert (choice.policy, choice.note, choice.seconds) == (None, NO_TIME, expected)


@pytest.mark.parametrize(("seconds", "particles"), [(0.05, 2048), (0.01, 1024)])
def test_a_vote_keeps_its_particles_unless_they_take_half_of_the_decision(
    monkeypatch, seconds, particles
):
    monkeypatch.setattr(Believer, "_measured", lambda *_: 0.01)
    policy = listener()
    voting = Believer(policy, particles=2048, filter=ParticleFilter(policy.planner))
    voting.prepare(seconds)
    assert voting.particles == particles


def test_thinking_is_chosen_where_the_belief_pays(simulator, believing, monkeypatch):
    monkeypatch.setattr(choosing, "_methods", lambda: [FirstActions()])
    monkeypatch.setattr(choosing, "believing", lambda *_: believing)
    monkeypatch.setattr(choosing, "Simulator", lambda *_: simulator)
    monkeypatch.setattr(simulator, "prepare", lambda *_: True)
    choice = choosing.choose(listener(), 2.0, clock=Ticking(0.01))
    assert choice.policy is not None
    assert choice.policy.base is believing
    # who only listens is sure after a while; before, it is not worth it
    (trial,) = choice.trials
    assert 5.0 < trial.mean < 11.0
