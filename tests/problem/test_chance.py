"""Whether chance plays a part in a problem."""

import pytest
from helpers.problems import TINY_DOMAIN, TINY_INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.problem import chance
from mdpo_rddl.problem.chance import actions_weigh_chances, has_draws, rewards_are_certain

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


WEIGHED = """
domain weighed {
    types { unit : object; };
    pvariables {
        s : { state-fluent, real, default = 0.0 };
        hit : { interm-fluent, bool };
        push : { action-fluent, bool, default = false };
    };
    cpfs { hit = HIT; s' = NEXT; };
    reward = REWARD;
}
non-fluents nf { domain = weighed; objects { unit : {u, v}; }; }
instance i {
    domain = weighed; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 3; discount = 1.0;
}
"""


@pytest.mark.parametrize(
    ("hit", "after", "reward", "expected"),
    [
        # the same noise whatever is done
        ("push", "s + push + Normal(0.0, 1.0)", "-abs[s]", False),
        ("push", "max[0.0, min[9.0, s + 2.0 * push + Poisson(3.0)]]", "s", False),
        ("Bernoulli(0.5)", "s + hit - push", "(2.0 * (s + push + hit)) / 3.0", False),
        ("push ^ (s > 1.0)", "s + hit", "s * Normal(0.0, 1.0)", False),
        # a chance that the action says, here or by what is computed before
        ("Bernoulli(0.3 + 0.4 * push)", "s + hit", "s", True),
        ("push", "s + Bernoulli(if (hit) then 0.2 else 0.4)", "s", True),
        # what is drawn counts only if something is done
        ("Bernoulli(0.5)", "if (push) then s + hit else s", "s", True),
        ("push ^ Bernoulli(0.5)", "s + hit", "s", True),
        ("Bernoulli(0.5)", "s", "s + hit * push", True),
        ("Bernoulli(0.5)", "s", "pow[s + hit, push]", True),
        ("Bernoulli(0.5)", "s", "(prod_{?u : unit} [ s + hit + push ])", True),
        ("Bernoulli(0.5)", "s", "(sum_{?u : unit} [ s + hit + push ])", False),
        # noise beside a threshold
        ("Uniform(0.0, 1.0) < 0.3 + 0.4 * push", "s + hit", "s", True),
        ("push + Normal(0.0, 1.0) > 0.5", "s + hit", "s", True),
    ],
)
def test_chances_may_be_up_to_the_actions(hit, after, reward, expected):
    text = WEIGHED.replace("HIT", hit).replace("NEXT", after).replace("REWARD", reward)
    assert actions_weigh_chances(problem_from(text).model) is expected


CHOSEN = """
domain chosen {
    types { box : {@red, @blue}; };
    pvariables {
        full(box) : { interm-fluent, bool };
        s : { state-fluent, real, default = 0.0 };
        pick : { action-fluent, box, default = @red };
    };
    cpfs { full(?b) = FULL; s' = s + full(pick); };
    reward = s;
}
non-fluents nf { domain = chosen; }
instance i {
    domain = chosen; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 3; discount = 1.0;
}
"""


@pytest.mark.parametrize(("full", "expected"), [("Bernoulli(0.5)", True), ("s > 1.0", False)])
def test_an_action_may_choose_what_was_drawn(full, expected):
    assert actions_weigh_chances(problem_from(CHOSEN.replace("FULL", full)).model) is expected


@pytest.mark.parametrize(
    ("spread", "seconds", "expected"),
    [("0.0", 60.0, True), ("0.5", 60.0, False), ("0.0", 0.0, False)],
)
def test_what_is_drawn_may_change_no_reward(spread, seconds, expected):
    instance = TINY_INSTANCE.replace("_HORIZON", "4").replace("_SPREAD", spread)
    problem = problem_from(TINY_DOMAIN + instance)
    assert has_draws(problem.model)
    assert rewards_are_certain(problem, seconds) is expected


def test_nothing_is_certain_of_what_cannot_be_played(monkeypatch):
    def refuse(problem):
        raise ValueError("no environment")

    monkeypatch.setattr(chance, "make_environment", refuse)
    instance = TINY_INSTANCE.replace("_HORIZON", "4").replace("_SPREAD", "0.0")
    assert not rewards_are_certain(problem_from(TINY_DOMAIN + instance), 60.0)
