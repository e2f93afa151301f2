"""Random actions: their law, many at once, and that they are legal."""

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.problem.random_actions import RandomActions
from mdpo_rddl.simulator.evaluation import RandomReplicas, evaluate_side_by_side
from mdpo_rddl.simulator.simulator import Simulator

# four lamps, two in each room
LAMPS = """
domain lamps {
  types { room : object; lamp : object; mood : {@calm, @angry, @glad}; };
  pvariables {
    IN(lamp, room) : { non-fluent, bool, default = false };
    burnt : { state-fluent, int, default = 0 };
    shine(lamp, room) : { action-fluent, bool, default = false };
    power(room) : { action-fluent, real, default = 0.0 };
    notch : { action-fluent, int, default = 0 };
    feel : { action-fluent, mood, default = @calm };
  };
  cpfs { burnt' = burnt + 1; };
  reward = sum_{?l : lamp, ?r : room} [shine(?l, ?r)];
  action-preconditions {
    forall_{?r : room} [(sum_{?l : lamp} [shine(?l, ?r)]) OPERATOR 1];
    forall_{?r : room} [power(?r) >= 0.0];
    forall_{?r : room} [power(?r) <= 4.0];
    notch >= 0; notch <= 2;
    notch + burnt ~= 2;
  };
}
non-fluents nf { domain = lamps; objects { room : {r1, r2}; lamp : {l1, l2, l3}; }; }
instance one { domain = lamps; non-fluents = nf; max-nondef-actions = MOST; horizon = 3;
  discount = 1.0; }
"""
COUNT = 4_000


def lamps(operator="<=", most="pos-inf"):
    return problem_from(LAMPS.replace("OPERATOR", operator).replace("MOST", most))


@pytest.mark.parametrize(("operator", "share"), [("<=", 0.5), ("==", 1.0)])
def test_groups_of_bools_keep_their_limit(operator, share):
    drawn = RandomActions(lamps(operator)).draws(COUNT, np.random.default_rng(0))
    shine = drawn["shine"]
    assert shine.shape == (3, 2, COUNT)
    assert set(np.unique(shine.sum(axis=0))) == ({0, 1} if operator == "<=" else {1})
    # each lamp of a room as likely as the others
    np.testing.assert_allclose(shine.mean(axis=-1), share / 3.0, atol=0.03)


def test_numbers_are_uniform_in_their_box():
    drawn = RandomActions(lamps()).draws(COUNT, np.random.default_rng(0))
    for name, values in {"notch": range(3), "feel": range(3)}.items():
        shares = [np.mean(drawn[name] == value) for value in values]
        np.testing.assert_allclose(shares, 1.0 / 3.0, atol=0.03)
    power = np.sort(drawn["power"][0])
    np.testing.assert_allclose(power, np.linspace(0.0, 4.0, COUNT), atol=0.12)


def test_no_more_fluents_leave_their_default_than_may():
    drawn = RandomActions(lamps(most="2")).draws(COUNT, np.random.default_rng(0))
    changed = sum((value != 0).reshape(-1, COUNT).sum(axis=0) for value in drawn.values())
    assert set(np.unique(changed)) == {0, 1, 2} or set(np.unique(changed)) == {2}
    # which of them stay is drawn
    assert all(np.any(value != 0) for value in drawn.values())


def test_replicas_are_legal_in_their_state():
    simulator = Simulator(lamps())
    policy = RandomReplicas(simulator, np.random.default_rng(0))
    found = evaluate_side_by_side(simulator, policy, 50, 0, keep=True)
    assert found.evaluation.illegal_actions == 0
    notch = found.trajectories.actions["notch"]
    assert [set(np.unique(each)) for each in notch] == [{0, 1}, {0, 2}, {1, 2}]
