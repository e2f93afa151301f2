"""Evaluation side by side pays and counts as play on the environment does."""

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.simulator.evaluation import evaluate_side_by_side
from mdpo_rddl.simulator.simulator import Simulator

# steps into the pit pay 5, and nothing is legal there
PIT = """
domain pit {
  pvariables {
    fallen : { state-fluent, bool, default = false };
    height : { state-fluent, int, default = 0 };
    jump : { action-fluent, bool, default = false };
  };
  cpfs { fallen' = fallen | (jump ^ Bernoulli(CHANCE)); height' = height + 1; };
  reward = if (jump) then 5 else -1;
  action-preconditions { ~fallen; };
}
non-fluents nf { domain = pit; }
instance one { domain = pit; non-fluents = nf; max-nondef-actions = 1; horizon = 6;
  discount = 0.5; }
"""


class Jumper:
    """Jumps at every step from the third one on."""

    def __call__(self, step, observation):
        return {"jump": np.full(observation["height"].shape, step >= 2)}

    def were_played(self, actions):
        """Nothing is remembered."""


def test_a_step_without_a_legal_action_pays_what_it_does_in_the_environment():
    problem = problem_from(PIT.replace("CHANCE", "1.0"))
    ours, _ = evaluate_side_by_side(Simulator(problem), Jumper(), 3, seed=0)
    theirs = evaluate(make_environment(problem), lambda t, s: {"jump": t >= 2}, 1, 0)
    # -1, -1, 5, and after the fall no more than -1 at each step
    assert theirs.returns.tolist() == [-1 - 0.5 + 5 / 4 - 1 / 8 - 1 / 16 - 1 / 32]
    assert ours.returns.tolist() == theirs.returns.tolist() * 3
    assert ours.unplayable.tolist() == [3, 3, 3]
    assert theirs.unplayable.tolist() == [3]
    assert ours.unmet == theirs.unmet
    assert (ours.illegal_actions, ours.fallback_actions) == (9, 0)


def test_what_an_episode_may_not_play_is_its_own():
    problem = problem_from(PIT.replace("CHANCE", "0.5"))
    simulator = Simulator(problem)
    simulator.block = 40
    ours, _ = evaluate_side_by_side(simulator, Jumper(), 100, seed=0)
    assert set(ours.unplayable) == {0, 1, 2, 3}
    for unplayable, value in zip(ours.unplayable, ours.returns, strict=True):
        played = [-1.0, -1.0] + [5.0] * (4 - unplayable) + [-1.0] * unplayable
        assert value == pytest.approx(sum(r / 2**t for t, r in enumerate(played)))
