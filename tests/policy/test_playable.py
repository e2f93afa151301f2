"""A policy as it is played."""

from types import SimpleNamespace
from typing import Any

import jax
import numpy as np

from mdpo_rddl.policy.playable import playable


def test_a_policy_takes_the_step_th_key_of_its_seed_to_the_end_of_the_episode():
    calls: list[tuple] = []

    def get_action(*arguments: Any) -> dict[str, Any]:
        calls.append(arguments)
        return {"push": len(calls)}

    # plans over two steps, plays five
    rddl, plan = SimpleNamespace(horizon=5), SimpleNamespace(train_policy=None)
    planner = SimpleNamespace(horizon=2, rddl=rddl, get_action=get_action, plan=plan)
    policy = playable(planner, "params", {"push": 1.0}, seed=9)
    state = {"x": np.array([1.0])}
    assert [policy(step, state) for step in range(5)] == [{"push": n} for n in range(1, 6)]
    keys = jax.random.split(jax.random.PRNGKey(9), 5)
    for step, (key, *rest) in enumerate(calls):
        np.testing.assert_array_equal(key, keys[step])
        assert rest == ["params", step, state, {"push": 1.0}]
