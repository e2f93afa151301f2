"""A policy as it is played."""

from types import SimpleNamespace
from typing import Any

import jax
import numpy as np

from mdpo_rddl.policy.playable import Playable, playable


class Planner:
    """Notes what it is asked for; plans over two steps, plays five."""

    horizon, plan = 2, SimpleNamespace(train_policy=None)
    rddl = SimpleNamespace(horizon=5, observ_fluents={})
    test_compiled = SimpleNamespace(init_values={})

    def __init__(self):
        self.calls: list[tuple] = []

    def get_action(self, *arguments: Any) -> dict[str, Any]:
        self.calls.append(arguments)
        return {"push": len(self.calls)}

    get_actions = get_action


def key_of(policy: Playable, planner: Planner, step: int, value: Any) -> list[int]:
    policy(step, {"x": np.array([value])})
    return planner.calls[-1][0].tolist()


def test_a_policy_is_asked_to_the_end_of_the_episode():
    planner = Planner()
    policy = playable(planner, "params", {"push": 1.0}, seed=9)
    state = {"x": np.array([1.0])}
    assert [policy(step, state) for step in range(5)] == [{"push": n} for n in range(1, 6)]
    for step, (_, *rest) in enumerate(planner.calls):
        assert rest == ["params", step, state, {"push": 1.0}]


def test_what_is_drawn_depends_on_the_seed_the_step_and_what_is_seen():
    planner = Planner()
    policy, other = (playable(planner, "params", {}, seed) for seed in (9, 8))
    key = key_of(policy, planner, 1, 1.0)
    # of other episodes that come by, too
    assert key_of(policy, planner, 0, 1.0) != key
    assert key_of(policy, planner, 1, 2.0) != key
    assert key_of(other, planner, 1, 1.0) != key
    # environments show some numbers in another type after a step
    assert key_of(policy, planner, 1, True) == key
    assert key != jax.random.split(jax.random.PRNGKey(9), 5)[1].tolist()


def test_episodes_side_by_side_draw_as_one_after_the_other_does():
    planner = Planner()
    policy = playable(planner, "params", {}, seed=9)
    policy.batch(3, {"x": np.array([[1.0], [2.0]])})
    keys = planner.calls[0][0].tolist()
    assert keys == [key_of(policy, planner, 3, value) for value in (1.0, 2.0)]
