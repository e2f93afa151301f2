"""Programs that play policies, one for each set of parts."""

import numpy as np
from helpers.clocks import Stopped

from mdpo_rddl.auto.search.by_parts import ByParts

KEY = np.zeros(2, np.uint32)


def test_each_set_of_parts_has_a_program_of_its_own():
    clock, made = Stopped(), []

    def make():
        made.append(len(made))
        clock.now += 10.0

        def play(key, params):
            clock.now += 1.0
            return sum(params.values())

        return play

    plays = ByParts(make, clock)
    assert (plays.seconds, plays.compile_seconds, plays.is_compiled()) == (0.0, 0.0, False)
    assert plays(KEY, {"plan": 1.0}) == plays(KEY, {"plan": 1.0}) == 1.0
    assert made == [0]
    assert (plays.seconds, plays.compile_seconds) == (1.0, 10.0)
    other = {"plan": 1.0, "shared": 2.0}
    assert plays.is_compiled()
    assert plays.is_compiled({"plan": 7.0})
    assert not plays.is_compiled(other)
    assert plays(KEY, other) == 3.0
    assert plays(KEY, {"plan": 5.0}) == 5.0
    assert made == [0, 1]
    assert plays.is_compiled(other)
    # one call only: all of it may have been compilation
    assert plays.compile_seconds == 10.0 + 11.0
