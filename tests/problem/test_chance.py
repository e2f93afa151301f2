"""Whether chance plays a part in a problem."""

import pytest
from helpers.problems import TINY_DOMAIN, TINY_INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.problem.chance import has_draws

CERTAIN = "SPREAD * Normal(0.0, 1.0)"


@pytest.mark.parametrize(
    ("noise", "expected"),
    [
        (CERTAIN, True),
        ("SPREAD * 2.0", False),
        ("DiracDelta(SPREAD)", False),
        ("DiracDelta(SPREAD + Normal(0, 1))", True),
        ("(if (x(?u) > 1.0) then SPREAD else Bernoulli(0.5))", True),
    ],
)
def test_a_draw_anywhere_in_the_dynamics_counts(noise, expected):
    instance = TINY_INSTANCE.replace("_HORIZON", "4").replace("_SPREAD", "0.0")
    assert has_draws(problem_from(TINY_DOMAIN.replace(CERTAIN, noise) + instance).model) is expected


def test_a_draw_in_the_reward_counts():
    instance = TINY_INSTANCE.replace("_HORIZON", "4").replace("_SPREAD", "0.0")
    domain = TINY_DOMAIN.replace(CERTAIN, "SPREAD").replace("GOAL, 2]]", "GOAL, 2]] + Normal(0, 1)")
    assert has_draws(problem_from(domain + instance).model)
