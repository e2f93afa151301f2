"""What the enumeration once took for something else, or took too long to refuse."""

import tracemalloc

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.toys import problem_from

from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.joint_actions import joint_actions
from mdpo_rddl.problem.enumeration.levels import Levels
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import ground_model
from mdpo_rddl.problem.limits import GroupLimit

# whether it is wet is drawn in two ways at once: most states follow from several draws
_RAIN = """domain d {
    types { o : object; };
    pvariables {
        wet(o) : { state-fluent, bool, default = true };
        stays : { state-fluent, bool, default = true };
        rain(o) : { interm-fluent, bool };
        work : { action-fluent, bool, default = false };
        leave : { action-fluent, bool, default = false };
    };
    cpfs {
        rain(?o) = Bernoulli(0.5);
        wet'(?o) = if (stays) then (wet(?o) | rain(?o)) else false;
        stays' = stays ^ ~leave ^ (exists_{?o : o} [wet(?o) | rain(?o)]);
    };
    reward = if (stays) then work * (sum_{?o : o} [wet(?o)]) / 4 else 0.5;
}"""

_LARGEST = """domain d {
    types { o : object; };
    pvariables {
        P(o) : { non-fluent, real, default = 0.5 };
        depth : { state-fluent, int, default = 0 };
        a : { action-fluent, bool, default = false };
    };
    cpfs { depth' = max_{?o : o} [if (Bernoulli(P(?o))) then 1 else 0]; };
    reward = depth - a;
}"""

_GUARD = """domain d {
    pvariables {
        open : { state-fluent, bool, default = false };
        wet : { state-fluent, bool, default = false };
        close : { action-fluent, bool, default = false };
    };
    cpfs {
        open' = if (close) then false else Bernoulli(0.5);
        wet' = open;
    };
    reward = -wet - 0.1 * close;
    PRECONDITIONS
}"""

_WAIT = """domain d {
    pvariables {
        wait : { state-fluent, int, default = 0 };
        served : { state-fluent, bool, default = false };
        serve : { action-fluent, bool, default = false };
    };
    cpfs {
        served' = Bernoulli(if (serve ^ (wait > 0)) then 0.5 else 0.0);
        wait' = if (served') then 0 else min[wait + 1, 3];
    };
    reward = if (served') then 10 / wait else 0;
}"""

_BROKEN = """domain d {
    pvariables {
        on : { state-fluent, bool, default = true };
        a : { action-fluent, bool, default = false };
    };
    cpfs { on' = false; };
    reward = 1.0;
    state-invariants { ~on; };
}"""

_WIDE = """domain d {
    pvariables {
        on : { state-fluent, bool, default = false };
        a : { action-fluent, int, default = 0 };
    };
    cpfs { on' = on; };
    reward = a;
    action-preconditions { a >= 0; a <= 1000000000; };
}"""

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

# after some steps each state has a chance of its own
_DIGITS = """domain d {
    pvariables {
        number : { state-fluent, int, default = 0 };
        lit : { state-fluent, bool, default = false };
        a : { action-fluent, bool, default = false };
    };
    cpfs {
        number' = 2 * number + a;
        lit' = Bernoulli(number / 4096);
    };
    reward = lit;
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


def test_the_largest_of_many_draws_is_worked_out_two_at_a_time():
    limits = EnumerationLimits(20.0, clock=Ticking(0.01))
    (law,) = ground_model(problem(_LARGEST, 40), limits).actions[0].laws
    assert len(law) == 2


def test_what_is_undefined_where_it_has_no_probability_counts_nothing():
    # wait one step, then serve: 10 with half a chance, else 5, 10 / 3 and 10 / 3
    value = {step: {0: 0.0, 1: 0.0, 2: 0.0, 3: 0.0} for step in range(6)}
    for step in reversed(range(5)):
        after = value[step + 1]
        for wait in range(4):
            idle = after[min(wait + 1, 3)]
            paid = 0.5 * (10 / wait + after[0]) + 0.5 * idle if wait else idle
            value[step][wait] = max(idle, paid)
    assert find_optimum(problem(_WAIT), 20.0).value == pytest.approx(value[0][0])


@pytest.mark.parametrize(
    ("domain", "cause"),
    [(_BROKEN, "initial state breaks an invariant"), (_WIDE, "1e.09 values of a")],
)
def test_what_is_refused(domain, cause):
    with pytest.raises(NotEnumerableError, match=cause):
        ground_model(problem(domain), EnumerationLimits(20.0))


def test_joint_actions_are_counted_exactly():
    variables = {("a", (place,)): (0, [1, 2]) for place in range(12)}
    graph = Graph()
    limits = EnumerationLimits(20.0)
    # 1, 12 * 2 and 66 * 4
    assert len(joint_actions(variables, 2, (graph, []), limits)) == 289


def bools(agents, tools):
    """Per tool of each agent whether it is used, of which each agent may use one."""
    variables = {("use", place): (False, [True]) for place in np.ndindex(agents, tools)}
    groups = np.broadcast_to(np.arange(agents)[:, np.newaxis], (agents, tools))
    return variables, GroupLimit({"use": groups}, np.ones(agents, int))


def test_actions_that_break_a_limit_are_not_counted():
    variables, limit = bools(2, 12)
    limits, unlimited = EnumerationLimits(20.0), (Graph(), [])
    with pytest.raises(NotEnumerableError, match=r"1.68e\+07 joint actions"):
        joint_actions(variables, 24, unlimited, limits)
    assert len(joint_actions(variables, 24, unlimited, limits, [limit])) == 13**2
    assert len(joint_actions(variables, 1, unlimited, limits, [limit])) == 1 + 24


def test_limits_leave_the_order_of_actions_as_it_is():
    variables, limit = bools(3, 2)
    limits, unlimited = EnumerationLimits(20.0), (Graph(), [])
    every = joint_actions(variables, 6, unlimited, limits)
    used = [np.reshape([*each.values()], (3, 2)).sum(axis=1) for each in every]
    kept = [each for each, uses in zip(every, used, strict=True) if np.all(uses <= 1)]
    assert len(kept) == 3**3
    assert joint_actions(variables, 6, unlimited, limits, [limit]) == kept


def test_a_limit_does_not_count_bools_that_are_true_by_default():
    variables, limit = bools(2, 2)
    variables["use", (0, 0)] = True, [False]
    found = joint_actions(variables, 4, (Graph(), []), EnumerationLimits(20.0), [limit])
    # both of the first agent's others, and one of the second's at most
    assert len(found) == 2 * 2 * 3


def test_values_that_are_never_allowed_are_not_counted():
    variables, _ = bools(1, 20)
    graph = Graph()
    leaves = [graph.leaf(Kind.ACTION, ground, True) for ground in variables]
    forbidden = [graph.make("not", leaf) for leaf in leaves[3:]]
    found = joint_actions(variables, 20, (graph, forbidden), EnumerationLimits(20.0))
    assert len(found) == 2**3
    assert not any(each[ground] for each in found for ground in [*variables][3:])


def test_a_chance_may_have_thousands_of_values():
    found = find_optimum(problem(_DIGITS, horizon=13), 20.0)
    # the number has one digit more at each step, and tells of the reward two steps later
    best = sum((2**digits - 1) / 4096 for digits in range(12))
    assert (found.value, found.optimum.states > 2**12) == (pytest.approx(best), True)


def test_levels_are_told_in_the_order_in_which_they_came_whenever_they_are_asked_for():
    levels = Levels()
    levels.of_rows(np.array([[3.0, 5.0, 0.25, 0.75]]))
    first = levels.tables()
    assert levels.tables() is first
    levels.of_bools(np.array([0.5, 1.0]))
    # the wider one is asked for with those that were there, once its values are joined
    levels.of_rows(np.array([[1.0, 2.0, 1.0, 7.0, 0.25, 0.25, 0.25, 0.25]]))
    values, probabilities = levels.tables()
    assert values[0].tolist() == [[3, 5, 0], [1, 0, 0], [1, 0, 0], [1, 2, 7]]
    assert probabilities.tolist() == [[0.25, 0.75, 0], [0.5, 0.5, 0], [1, 0, 0], [0.5, 0.25, 0.25]]
