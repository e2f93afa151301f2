"""When the environment raises an error, as RDDL, against the environment."""

import itertools

import pytest
from helpers.toys import problem_from
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.errors_in_play import NoConditionError, error_condition
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.underlying import underlying_mdp

DOMAIN = """domain odds {
    types { item : object; way : {@low, @mid, @high}; };
    pvariables {
        SHARE(item) : { non-fluent, real, default = 0.5 };
        height : { state-fluent, int, default = HEIGHT };
        mode : { state-fluent, way, default = MODE };
        open(item) : { state-fluent, bool, default = OPEN };
        rings(item) : { interm-fluent, bool };
        drawn : { interm-fluent, real };
        pick : { interm-fluent, way };
        total : { interm-fluent, real };
        wait : { action-fluent, bool, default = false };
    };
    cpfs {
        height' = height;
        mode' = mode;
        open'(?i) = open(?i);
        LAWS
    };
    reward = REWARD;
}
non-fluents nf { domain = odds; objects { item : {a, b}; }; non-fluents { SHARE(b) = 1.5; }; }
instance i { domain = odds; non-fluents = nf; max-nondef-actions = 1; horizon = 2; discount = 1.0; }
"""
QUIET = {"rings(?i)": "false", "drawn": "0.0", "pick": "@low", "total": "0.0"}
LAWS = {
    "if": ("rings(?i)", "if (open(?i)) then Bernoulli(height * SHARE(?i)) else false"),
    "else": ("rings(?i)", "if (height > 1) then Bernoulli(0.3) else Bernoulli(height + 1.0)"),
    "switch": (
        "drawn",
        """switch (mode) { case @low : Poisson(height + 1), case @high : 3.0,
            default : Binomial(3 + height, 0.5 * height) }""",
    ),
    "Normal": ("drawn", "Normal(-height, 2 - height)"),
    "Discrete": (
        "pick",
        "Discrete(way, @low : 0.5 * height, @mid : 1.0 - 0.5 * height, @high : 0)",
    ),
    "sum to 1": ("pick", "Discrete(way, @low : 0.25, @mid : 0.25, @high : 0.5 * (height + 1))"),
    "each": ("total", "sum_{?i : item} [ Exponential(SHARE(?i) + height) ]"),
    "within": ("total", "max[Geometric(0.5 * (height + 1)), exp[Bernoulli(0.5)]]"),
    "not normed": (
        "pick",
        "UnnormDiscrete(way, @low : 1 - height, @mid : 1 - height, @high : 0.0)",
    ),
    "no number": ("drawn", "Normal(0, sqrt[height])"),
    "certain": ("total", "DiracDelta(height) + Exponential(height + 1)"),
}


def odds(laws, reward="height", height=0, mode="@low", is_open=False):
    written = "\n".join(f"{name} = {law};" for name, law in {**QUIET, **laws}.items())
    text = DOMAIN.replace("LAWS", written).replace("REWARD", reward)
    text = text.replace("HEIGHT", str(height)).replace("MODE", mode)
    return problem_from(text.replace("OPEN", str(is_open).lower()))


def reward_of_a_step(problem) -> float:
    env = make_environment(problem)
    env.reset(seed=0)
    return float(env.step({})[1])


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_it_is_true_where_the_environment_raises_an_error(law):
    name, expression = law
    condition = error_condition(odds({name: expression}, height=0).model)
    seen = set()
    # pyRDDLGym looks at all cases of a `switch` where the third one is taken
    states = itertools.product(range(-2, 5), ("@low", "@mid"), (False, True))
    for height, mode, is_open in states:
        state = {"height": height, "mode": mode, "is_open": is_open}
        told = reward_of_a_step(odds({}, condition, **state)) == 1.0
        try:
            reward_of_a_step(odds({name: expression}, **state))
            raised = False
        except (InputError, RDDLValueOutOfRangeError) as error:  # at the first sight, or in play
            raised = "must " in str(error)
        assert told == raised, state
        seen.add(raised)
    assert seen == {False, True}


@pytest.mark.parametrize(
    "law", ["Bernoulli(0.25)", "KronDelta(height > 1)", "Weibull(1.0, 2.0) > 1", "height > 1"]
)
def test_where_no_law_can_leave_its_range_nothing_is_known(law):
    with pytest.raises(NoConditionError, match="no law"):
        error_condition(odds({"rings(?i)": law}).model)


@pytest.mark.parametrize(
    ("law", "cause"),
    [
        (("drawn", "Weibull(height + 1, 1.0)"), "Weibull is not known"),
        (("rings(?i)", "Bernoulli(Normal(0.5, 1.0))"), "is drawn"),
        (("rings(?i)", "if (Bernoulli(0.5)) then Bernoulli(height) else false"), "is drawn"),
    ],
)
def test_where_a_reward_may_not_read_it_nothing_is_known(law, cause):
    with pytest.raises(NoConditionError, match=cause):
        error_condition(odds(dict([law])).model)


def test_a_law_of_an_observation_may_read_the_next_state():
    text = DOMAIN.replace("interm-fluent, bool", "observ-fluent, bool").replace(
        "LAWS", "rings(?i) = Bernoulli(height' * SHARE(?i)); drawn = 0; pick = @low; total = 0;"
    )
    for word, value in {"HEIGHT": "0", "MODE": "@low", "OPEN": "true", "REWARD": "height"}.items():
        text = text.replace(word, value)
    condition = error_condition(problem_from(text).model)
    told = [reward_of_a_step(odds({}, condition, height=height)) for height in (0, 1, 2)]
    # 1.5 and 3 are the chances of one of the two
    assert told == [0.0, 1.0, 1.0]


def test_a_law_of_the_reward_counts_too():
    problem = odds({}, reward="Bernoulli(0.5 * height)")
    condition = error_condition(problem.model)
    assert [reward_of_a_step(odds({}, condition, height=h)) for h in (0, 2, 3)] == [0.0, 0.0, 1.0]


def test_an_error_costs_what_it_is_told_to_in_the_underlying_mdp():
    law = {"rings(?i)": "Bernoulli(SHARE(?i) * height)"}
    problem = odds(law, reward="if (height > 1) then height else 2 - height", height=0)
    assert reward_of_a_step(problem) == reward_of_a_step(underlying_mdp(problem)) == 2.0
    charged = underlying_mdp(problem, error_cost=7.5)
    assert reward_of_a_step(charged) == 2.0
    # the environment raises the error before there is a reward
    text = charged.domain_text.replace("Bernoulli(SHARE(?i) * height)", "false")
    for height, reward in {0: 2.0, 1: 1.0 - 7.5, 2: 2.0 - 7.5, -1: 3.0 - 7.5}.items():
        own = text.replace("int, default = 0", f"int, default = {height}")
        assert reward_of_a_step(problem_from(own + charged.instance_text)) == reward
