"""What leads trials: hope after an action, and a guess of what was not tried."""

from functools import partial

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.toys import toy

from mdpo_rddl.auto.search.trials import guide as guides
from mdpo_rddl.auto.search.trials.backward import Future, induct, swept
from mdpo_rddl.auto.search.trials.explored import NEVER, Explored
from mdpo_rddl.auto.search.trials.guide import guide
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import ground_model

LIMITS = EnumerationLimits(seconds=1e9, clock=Ticking())
MODEL = ground_model(toy("quest"), LIMITS)


def explored(draws: int = 60) -> Explored:
    """What random play has seen in so many draws from states that were seen before."""
    found, random = Explored(MODEL, LIMITS), np.random.default_rng(1)
    for _ in range(draws):
        open_ones = np.flatnonzero(found.depth.values < MODEL.horizon - 1)
        state = random.choice(open_ones, 1)
        row = found.first_row.values[state] + random.integers(found.row_count.values[state])
        found.draw(row, found.depth.values[state].astype(np.int64), random)
    return found


def unknown(seen: Explored) -> tuple[np.ndarray, np.ndarray]:
    """Of which rows nothing is known [R], and which states have such rows [S]."""
    rows, states = ~seen.was_drawn()[seen.afterstate.values], np.zeros(seen.size, bool)
    states[seen.owners()[rows]] = True
    return rows, states


def sooner_is_better(seen: Explored, step: int) -> np.ndarray:
    return np.full(seen.size, 1000.0 - 10.0 * step)


def test_hope_mixes_the_best_that_has_followed_with_the_mean():
    seen = explored()
    values = np.arange(float(seen.size))
    mean, hopeful = (Future(seen, 1.0, hope).values(values, 3) for hope in (0.0, 0.25))
    tried = 0
    for afterstate in range(seen.after_index.count):
        following = values[seen.next.values[seen.origin.values == afterstate]]
        expected = mean[afterstate]
        if len(following):
            expected = 0.75 * expected + 0.25 * following.max()
            tried += len(following) > 1
        assert hopeful[afterstate] == pytest.approx(expected)
    assert tried


def test_an_action_that_was_not_tried_is_worth_the_guess():
    seen = explored()
    unseen, has_unseen = unknown(seen)
    assert 0 < np.count_nonzero(has_unseen) < seen.size
    rows, worth = swept(seen, Future(seen, 1.0), guess=partial(sooner_is_better, seen))
    assert np.array_equal(unseen[rows[0]], has_unseen)
    reached = has_unseen & (seen.depth.values < MODEL.horizon - 1)
    assert np.array_equal(worth[reached], 1000.0 - 10.0 * seen.depth.values[reached])


def test_the_guess_is_a_linear_function_of_variables_and_steps_between_its_bounds():
    seen = explored(200)
    states = np.flatnonzero(seen.depth.values < MODEL.horizon)
    columns = [MODEL.packing.decode(each, seen.index.states) for each in range(8)]
    truth = 3.0 + 2.0 * columns[0] - columns[6] - 0.1 * seen.depth.values
    guess = guides._fitted(seen, states, truth)
    for step in range(3):
        here = states[seen.depth.values[states] == step]
        assert guess(step)[here] == pytest.approx(truth[here], abs=0.02)
    assert guess(0).max() <= truth[states].max()
    assert guess(MODEL.horizon).min() >= truth[states].min()


def test_the_guide_follows_the_guess(monkeypatch):
    seen = explored()
    unseen, has_unseen = unknown(seen)
    monkeypatch.setattr(guides, "_fitted", lambda *given: partial(sooner_is_better, seen))
    assert np.array_equal(unseen[guide(seen).rows[0]], has_unseen)


def test_where_nothing_was_tried_there_is_nothing_to_fit_to():
    new = Explored(MODEL, LIMITS)
    assert np.array_equal(guide(new).rows, induct(new, 1.0).rows)


def test_depths_are_the_least_by_all_that_was_seen():
    seen = explored(200)
    owners, least = seen.owners(), {0: 0}
    waiting = [0]
    while waiting:
        state = waiting.pop(0)
        for afterstate in set(seen.afterstate.values[owners == state]):
            for following in seen.next.values[seen.origin.values == afterstate]:
                if following not in least:
                    least[following] = least[state] + 1
                    waiting.append(following)
    by_detours = [least[state] for state in range(seen.size)] != seen.depth.values.tolist()
    seen.shorten_depths()
    assert by_detours
    assert [least.get(state, NEVER) for state in range(seen.size)] == seen.depth.values.tolist()
