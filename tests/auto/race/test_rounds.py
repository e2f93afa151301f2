"""Who gets the next slice, by figures worked by hand."""

from dataclasses import dataclass

import pytest

from mdpo_rddl.auto.race import rounds
from mdpo_rddl.auto.race.rounds import Contender, gives_way, next_contender, raising


@dataclass
class Idle:
    """An arm of which only its state matters."""

    is_exhausted: bool = False
    is_pending: bool = False
    is_late: bool = False

    def is_worth_waiting(self, seconds):
        """Where it can be ready in time."""
        assert seconds == 100.0
        return not self.is_late


def contender(reached: float | None, pace: float = 0.0, slices: int = 2, waited: int = 0, **arm):
    return Contender(Idle(**arm), lambda: reached, slices, pace, waited)


def test_everybody_has_two_slices_before_anything_is_made_of_the_pace():
    leading, new = contender(10.0, pace=5.0), contender(-90.0, slices=1)
    assert next_contender([leading, new], 0, 10.0, 100.0) is new


def test_the_largest_claim_gets_the_slice():
    # half of the pace is believed: 10 + 0.5 x 1 x 100, 0 + 0.5 x 2 x 100
    slow, fast = contender(10.0, pace=1.0), contender(0.0, pace=2.0)
    assert slow.claim(100.0) == 60.0
    assert fast.claim(100.0) == 100.0
    assert next_contender([slow, fast], 0, 10.0, 100.0) is fast
    # too late to catch up
    assert next_contender([slow, fast], 0, 10.0, 10.0) is slow


def test_one_slice_in_eight_is_for_whoever_has_waited_longest():
    leading, other = contender(10.0, pace=1.0), contender(-50.0, waited=3)
    chosen = [next_contender([leading, other], number, 10.0, 100.0) for number in range(8)]
    assert chosen == [leading] * 7 + [other]


def test_where_nobody_promises_more_they_take_turns():
    leading, other = contender(10.0), contender(-50.0, waited=1)
    assert next_contender([leading, other], 0, 10.0, 100.0) is other


def test_who_compiles_or_has_ended_gets_none():
    pending = contender(None, slices=0, is_pending=True)
    exhausted = contender(20.0, pace=9.0, is_exhausted=True)
    able = contender(1.0)
    assert next_contender([pending, exhausted, able], 0, 20.0, 100.0) is able
    assert next_contender([pending, exhausted], 0, 20.0, 100.0) is None


def test_the_pace_is_the_gain_a_second_and_lasts_a_while():
    returns = iter([4.0, 4.0, 24.0])
    one = Contender(Idle(), lambda: next(returns))
    one.note(before=None, seconds=2.0)  # the first slice has nothing to compare with
    assert (one.slices, one.pace) == (1, 0.0)
    one.pace = 6.0
    one.note(before=4.0, seconds=2.0)
    assert one.pace == 3.0
    one.note(before=4.0, seconds=2.0)
    assert (one.slices, one.pace) == (3, 10.0)


@pytest.mark.parametrize("reached", [None, float("-inf")])
def test_who_has_found_nothing_claims_nothing(reached):
    assert contender(reached, pace=1.0).claim(10.0) == float("-inf")


@pytest.mark.parametrize(("gains", "turns"), [([1.0, 1.0, 0.0], 3), ([-1.0], 1)])
def test_turns_end_with_the_first_that_raises_nothing(gains, turns):
    reached = [0.0]
    for number, _ in enumerate(raising(lambda: sum(reached))):
        reached.append(gains[number])
    assert len(reached) - 1 == turns


def test_a_small_gain_is_none():
    gains, reached = iter([3.0, 2.0]), [0.0]
    for _ in raising(lambda: sum(reached), by=lambda: 2.0):
        reached.append(next(gains))
    assert reached == [0.0, 3.0, 2.0]


@pytest.mark.parametrize(
    ("promising", "cores", "pending", "expected"),
    [
        # 10 + 0.5 x 0 x 100 is no more than the best return, 10 + 0.5 x 1 x 100 is
        ({}, 1, {}, True),
        ({"pace": 1.0}, 1, {}, False),
        # what it finds is not known yet
        ({"slices": 0}, 1, {}, False),
        ({"slices": 1}, 1, {}, True),
        # nothing is delayed on a core of its own
        ({}, 2, {}, False),
        ({}, 1, {"is_late": True}, False),
    ],
)
def test_who_promises_nothing_waits_for_a_compilation(
    monkeypatch, promising, cores, pending, expected
):
    monkeypatch.setattr(rounds, "usable_cores", lambda: cores)
    late, compiling = Idle(is_late=True), Idle(is_pending=True, **pending)
    assert gives_way(contender(10.0, **promising), [late, compiling], 10.0, 100.0) == expected
    assert not gives_way(contender(10.0, **promising), [], 10.0, 100.0)
