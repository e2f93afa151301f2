"""What the enumeration once took for something else, or took too long to refuse."""

import tracemalloc

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.toys import problem_from

from mdpo_rddl.auto.optimum import find_optimum
from mdpo_rddl.auto.search.trials.backward import annuity, induct
from mdpo_rddl.auto.search.trials.explored import Explored
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import ground_model

_INSTANCE = """
non-fluents nf {{ domain = d; {objects} }}
instance i {{
    domain = d; non-fluents = nf; max-nondef-actions = 1;
    horizon = {horizon}; discount = {discount};
}}
"""

_CRASH = """domain d {
    pvariables {
        crashed : { state-fluent, bool, default = false };
        fuel : { state-fluent, int, default = 5 };
        go : { action-fluent, bool, default = false };
    };
    cpfs {
        crashed' = crashed | (go ^ Bernoulli(0.5));
        fuel' = fuel - 1;
    };
    reward = if (crashed) then 0.0 else go + 0.25 * (fuel > 0);
}"""

_SUM = """domain d {
    types { o : object; };
    pvariables {
        W(o, o) : { non-fluent, real, default = 1.0 };
        on : { state-fluent, bool, default = false };
        a : { action-fluent, bool, default = false };
    };
    cpfs { on' = on | a; };
    reward = sum_{?x : o, ?y : o, ?z : o} [W(?x, ?y) * W(?y, ?z) * on];
}"""

_PICK = """domain d {
    types { o : object; };
    pvariables {
        on : { state-fluent, bool, default = false };
        pick(o, o) : { action-fluent, bool, default = false };
    };
    cpfs { on' = on | (exists_{?x : o, ?y : o} [pick(?x, ?y)]); };
    reward = on;
}"""

_IDLE = """domain d {
    types { o : object; };
    pvariables {
        on(o) : { state-fluent, bool, default = false };
        risk : { action-fluent, bool, default = false };
    };
    cpfs { on'(?x) = if (risk) then Bernoulli(0.5) else on(?x); };
    reward = 1.0 + 0.5 * risk;
}"""


def problem(domain, objects=0, horizon=5, discount=1.0):
    names = ", ".join(f"o{number}" for number in range(objects))
    those = f"objects {{ o : {{{names}}}; }};" if objects else ""
    return problem_from(
        domain + _INSTANCE.format(objects=those, horizon=horizon, discount=discount)
    )


def test_an_int_that_no_longer_matters_goes_on_falling():
    # go for 1 and lose all that follows with half a chance, or wait for 0.25
    value = 0.0
    for _ in range(5):
        value = max(1.25 + 0.5 * value, 0.25 + value)
    assert find_optimum(problem(_CRASH), 20.0).value == pytest.approx(value)


def test_the_clock_is_looked_at_within_an_expression():
    limits = EnumerationLimits(20.0, clock=Ticking(1.0))
    with pytest.raises(NotEnumerableError, match="more than 20 s"):
        ground_model(problem(_SUM, 40), limits)


def test_too_many_joint_actions_are_refused_before_they_are_made():
    many = problem(_PICK, 80)
    tracemalloc.start()
    try:
        with pytest.raises(NotEnumerableError, match="5,000 joint actions"):
            ground_model(many, EnumerationLimits(60.0))
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("discount", "steps"), [(1.0, 7), (0.5, 3), (0.0, 2), (0.9, 0)])
def test_an_annuity_is_the_sum_of_its_payments(discount, steps):
    assert annuity(discount, steps) == pytest.approx(sum(discount**k for k in range(steps)))


def test_what_was_not_seen_is_discounted():
    idle = problem(_IDLE, 20, horizon=40, discount=0.5)
    limits = EnumerationLimits(60.0)
    explored = Explored(ground_model(idle, limits), limits)
    # nothing was seen yet: the first action's reward, then the no-op's for ever
    assert induct(explored, 0.0).value == pytest.approx(1.5 + 0.5 * 2.0, abs=1e-6)
    assert np.all(np.isfinite(induct(explored, 1.0).rows))
