"""Whether to think at all: what the trials of the methods say, and how long they may take."""

import weakref
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from unittest.mock import create_autospec

import numpy as np
import pytest
from helpers.clocks import Stopped, Ticking
from helpers.levers import NONE, lever_policy
from helpers.mistakes import one_line
from helpers.slow_simulator import SlowSimulator
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from benchmarks.tasks.published_episodes import published_seeds
from mdpo_rddl.planner.exact.continuations import Continuations
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.lookahead import choice as choosing
from mdpo_rddl.policy.lookahead.base import Tabled
from mdpo_rddl.policy.lookahead.choice import choose
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.sequences import Sequences
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE, Simulator
from mdpo_rddl.policy.lookahead.trials import NO_TIME, Trial
from mdpo_rddl.problem.evaluation import episode_seeds

SECONDS = 0.5
START = {"pulled": np.zeros(3, bool)}


@pytest.fixture
def slow(monkeypatch):
    """Makes simulators whose calls take a given time; the clock stands still otherwise."""

    def use(call, preparation=0.0):
        clock = Stopped()

        def make(policy, depth, _):
            return SlowSimulator(policy, clock, {WIDE: call, NARROW: call}, preparation)

        monkeypatch.setattr(choosing, "Simulator", make)
        return clock

    return use


def test_an_optimal_policy_is_played_alone():
    # nothing is random: what the third arm pays is all that there is to gain
    choice = choose(lever_policy((1, 0, 1)), SECONDS, clock=Ticking(0.001))
    assert choice.policy is None
    assert [trial.mean for trial in choice.trials] == [0.0, 0.0, 0.0]
    assert choice.note == "no gain"


def test_the_method_that_gains_is_chosen(slow):
    clock = slow(call=0.01)
    choice = choose(lever_policy(NONE), SECONDS, clock=clock)
    assert choice.policy is not None
    assert all(trial.mean == pytest.approx(1.0, abs=0.3) for trial in choice.trials)
    best = max(choice.trials, key=lambda trial: trial.mean)
    assert choice.policy.method.name == best.method
    assert choice.policy.decisions == []
    assert choice.note == ""


def test_decisions_too_short_for_a_method_are_no_result(slow):
    clock = slow(call=0.5)
    choice = choose(lever_policy(NONE), SECONDS, clock=clock)
    assert choice.policy is None
    assert [trial.note for trial in choice.trials] == [NO_TIME] * 3
    assert not any(trial.pays for trial in choice.trials)


def test_methods_share_the_time(slow):
    clock = slow(call=0.01, preparation=2.0)
    choice = choose(lever_policy(NONE), SECONDS, within=6.0, clock=clock)
    assert choice.seconds <= 6.0
    assert [trial.note for trial in choice.trials] == [""] * 3
    # of the time that is left after the preparation each method has enough for a few decisions
    clock = slow(call=0.01, preparation=5.5)
    choice = choose(lever_policy(NONE), SECONDS, within=6.0, clock=clock)
    assert choice.seconds <= 1.2 * 6.0 + SECONDS
    assert {trial.note for trial in choice.trials} == {NO_TIME}
    # where decisions are short they are tried all the same
    clock = slow(call=0.001, preparation=6.5)
    choice = choose(lever_policy(NONE), 0.05, within=6.0, clock=clock)
    assert choice.seconds <= 1.2 * 6.0
    assert {trial.note for trial in choice.trials} == {""}


def test_no_compilation_begins_that_would_end_late():
    """By a clock that ticks the first program takes some twenty seconds."""
    choice = choose(lever_policy(NONE), 0.05, within=50.0, clock=Ticking(1.0))
    assert choice.policy is None
    assert {trial.note for trial in choice.trials} == {NO_TIME}
    assert choice.note == NO_TIME
    assert choice.seconds <= 50.0


def test_the_states_of_trials_are_of_episodes_that_no_evaluation_plays(monkeypatch):
    seeds, reset = [], RDDLEnv.reset

    def spied(env, seed=None, **more):
        seeds.append(seed)
        return reset(env, seed=seed, **more)

    monkeypatch.setattr(RDDLEnv, "reset", spied)
    policy = lever_policy(NONE)
    choosing._visited(policy, lambda: True)
    played = {seed for seed in seeds if seed}  # legal actions are counted with 0
    assert len(played) == 4
    evaluated = {one for run in range(50) for one in episode_seeds(run, 50)}
    assert not played & (evaluated | set(published_seeds(100)))


def test_few_of_the_states_are_kept_while_they_are_visited(monkeypatch):
    class Known(dict):
        """A state of which it can be seen whether it is kept."""

    references, kept = [], []

    def known_at(policy, step, state, is_tried=False):
        kept.append(sum(reference() is not None for reference in references))
        known = Known(state)
        references.append(weakref.ref(known))
        return known

    monkeypatch.setattr(choosing, "known_at", known_at)
    monkeypatch.setattr(choosing, "MOST_STATES", 3)
    # of four episodes with four steps each
    visited = choosing._visited(lever_policy(NONE), lambda: True)
    assert len(references) == 16
    assert len(visited) == 3
    assert visited[0][1] is references[0]()
    # and the one at hand
    assert max(kept) <= 2 * 3 + 1


@pytest.mark.parametrize(
    ("first", "each", "count"), [(100.0, 0.0, 16), (100.0, 0.4, 6), (9.0, 9.0, 4)]
)
def test_states_are_visited_although_the_first_decision_must_be_compiled(first, each, count):
    clock = Stopped()

    class Slow:
        problem, seed = lever_policy(NONE).problem, 0

        def __call__(self, step, state):
            clock.now += first if clock.now == 0.0 else each
            return lever_policy(NONE)(step, state)

    assert len(choosing._visited(Slow(), choosing._lasting(1.0, clock))) == count


def test_nobody_thinks_where_the_environment_fails(monkeypatch):
    def failing(env, action):
        raise RDDLValueOutOfRangeError("a probability above 1")

    monkeypatch.setattr(RDDLEnv, "step", failing)
    choice = choose(lever_policy(NONE), SECONDS)
    assert (choice.policy, choice.note) == (None, choosing.RAISES)
    # a table is not looked at either where that is known
    table = create_autospec(Tabled, optimum=None, problem=SimpleNamespace(raises=True))
    assert choose(table, SECONDS).note == choosing.RAISES


def test_a_table_that_takes_all_the_time_is_played_alone(monkeypatch):
    clock, table = (
        Stopped(),
        create_autospec(Tabled, optimum=None, problem=SimpleNamespace(raises=False)),
    )

    def take_long(_):
        clock.now += 5.0
        return lever_policy(NONE)

    monkeypatch.setattr(choosing, "TableBase", take_long)
    choice = choose(table, SECONDS, within=5.0, clock=clock)
    assert (choice.policy, choice.note, choice.seconds) == (None, NO_TIME, 5.0)


def test_a_call_of_another_length_does_where_it_cannot_be_compiled_again():
    simulator = Simulator(lever_policy(NONE, LIKELIHOOD="0.75"), 1, Ticking(0.01))
    # calls are too long for such decisions, and there is time for one more program
    assert simulator.prepare(START, 0.2, until=0.7)
    assert simulator.scenarios(WIDE) == 128 // 2**3
    assert simulator.scenarios(NARROW) == 128 // 4
    assert not Simulator(lever_policy(NONE), 1, Ticking(0.01)).prepare(START, 0.02, until=0.7)


def test_without_trials_there_was_no_time():
    assert choosing.Choice(None, [], "", 0.0).note == NO_TIME
    assert choosing.Choice(None, [Trial("sequences", 0.0, 1.0)], "", 0.0).note == "no gain"


def test_nothing_is_tried_where_the_first_call_is_far_too_long(monkeypatch):
    monkeypatch.setattr(Simulator, "_differs", None)
    simulator = Simulator(lever_policy(NONE, LIKELIHOOD="0.75"), 1, Ticking(0.01))
    assert not simulator.prepare(START, 0.001)


def test_the_finalists_calls_are_the_search_s_where_others_would_be_compiled_too_late():
    simulator = Simulator(lever_policy(NONE, LIKELIHOOD="0.75"), 1, Ticking(0.01))
    assert simulator.prepare(START, 0.2, until=0.1)
    assert simulator.scenarios(NARROW) == simulator.scenarios(WIDE) == 128 // 2**3
    assert (simulator.challengers(NARROW), simulator.challengers(WIDE)) == (3, 7)
    assert simulator.seconds(NARROW, 0) == simulator.seconds(WIDE, 0)
    method = FirstActions()
    assert method.applies(simulator.components)
    policy = LookaheadPolicy(simulator, method, 0.2, 0, Ticking(0.001))
    policy(0, START)
    assert policy.decisions[0].calls


@pytest.mark.parametrize("place", [(0, START), (2, {"pulled": np.array([True, False, False])})])
def test_what_is_random_where_the_policy_leads_alone_is_not_certain(place, monkeypatch):
    """Elsewhere, and after all other first actions, all scenarios return the same."""
    base = np.array([1.0, 0.0, 1.0], np.float32)
    is_drawn, random_step = [], place[0]

    def compile_one(_, size, is_rounded):
        def returns(key, params, hyperparams, state, step, candidates):
            is_base = np.all(candidates[:, 0] == base, axis=1)
            is_drawn.append(np.any(is_base[1:]) and not np.all(is_base))
            numbers = np.arange(size.scenarios, dtype=np.float32)
            return (is_base & (step == random_step))[:, None] * numbers

        return returns

    monkeypatch.setattr(Continuations, "compile", compile_one)

    def scenarios(*others):
        simulator = Simulator(lever_policy(base, LIKELIHOOD="0.75"), 1, Ticking(0.01))
        assert simulator.prepare(START, SECONDS, np.inf, others)
        return simulator.scenarios(WIDE)

    assert scenarios((1, START), place) > 2
    assert not any(is_drawn)
    assert (scenarios((1, START)) == 2) == (random_step > 0)


def test_an_agent_that_thinks_is_played_as_its_policy_is(slow, tmp_path, monkeypatch):
    policy = lever_policy(NONE)
    clock = slow(call=0.01)
    monkeypatch.setattr(choosing, "choose", partial(choose, clock=clock))
    thinker = policy.with_decision_seconds(SECONDS)
    assert isinstance(thinker, LookaheadPolicy)
    assert thinker.problem is policy.problem
    thinker.reset()
    assert thinker.sample_action(START)["pull"][2]
    ground = {f"pulled___a{arm}": False for arm in (1, 2, 3)}
    thinker.reset()
    assert thinker.sample_action(ground)["pull___a3"]
    # the third arm at each step, whatever the others
    assert thinker.evaluate(episodes=1).mean >= 4 * (3.0 - 2.0)
    thinker.save(tmp_path / "one.policy")
    saved = load_policy(tmp_path / "one.policy")
    assert saved.seed == policy.seed
    for wrong in (0.0, -1.0, float("nan")):
        assert "must be a number above 0" in one_line(partial(policy.with_decision_seconds, wrong))


def test_a_gain_within_its_error_does_not_pay():
    assert Trial("one", 1.0, 0.9).pays
    assert not Trial("one", 1.0, 1.0).pays
    assert not Trial("one", 0.5, 1.0).pays
    assert not Trial("one", 0.0, 0.0).pays
    assert not Trial("one", None, None, NO_TIME).pays


def test_where_a_call_would_take_too_much_memory_the_policy_plays_alone(slow, monkeypatch):
    clock = slow(0.01)
    monkeypatch.setattr(choosing, "_MOST_FLUENT_BYTES", 1)
    choice = choose(lever_policy(NONE), SECONDS, 60.0, clock)
    assert (choice.policy, choice.note) == (None, choosing.LARGE)


def test_where_the_environment_raises_an_error_the_policy_plays_alone(slow):
    policy = lever_policy(NONE)
    policy = replace(policy, problem=replace(policy.problem, raises=True))
    choice = choose(policy, SECONDS, 60.0, slow(0.01))
    assert (choice.policy, choice.note) == (None, choosing.RAISES)


def test_states_are_visited_as_play_would(monkeypatch):
    class Eager:
        problem, seed = lever_policy(NONE, MOST="1").problem, 0

        def __call__(self, step, state):
            return {"pull": np.ones(3, bool)}  # more than may be pulled at once

    played = []
    step = RDDLEnv.step

    def watched(env, actions):
        played.append(int(np.sum(actions["pull"])))
        return step(env, actions)

    monkeypatch.setattr(RDDLEnv, "step", watched)
    assert choosing._visited(Eager(), lambda: True)
    assert max(played) <= 1


@pytest.mark.parametrize(
    ("chance", "wanted", "depth"), [(False, 1, 4), (True, 1, 2), (False, 10**9, 2)]
)
def test_candidates_reach_to_the_horizon_where_plans_are_kept(monkeypatch, chance, wanted, depth):
    made = []

    class Refusing(SlowSimulator):
        def prepare(self, *_):
            return False

    def simulator(policy, depth, clock):
        made.append(depth)
        return Refusing(policy, clock, {})

    monkeypatch.setattr(choosing, "Simulator", simulator)
    monkeypatch.setattr(choosing, "has_draws", lambda model: chance)
    monkeypatch.setattr(choosing, "_WHOLE_PLANS", wanted)
    # the horizon is 4
    choose(lever_policy(NONE), SECONDS, clock=Stopped(), methods=[Sequences(depth=2)])
    assert made == [depth]
