"""Every kind of expression against pyRDDLGym's environment, on problems of a few objects."""

import numpy as np
import pytest
from helpers.toys import problem_from
from scipy import stats

from benchmarks.problems.simulator_law import QUANTILES, compare
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.simulator.simulator import Simulator

# what is read: A and M constants, x, s, k, b and c of the state, push and set actions
FLUENTS = """
  types { item : object; color : {@red, @green, @blue}; };
  pvariables {
    A(item) : { non-fluent, real, default = 1.5 };
    LINK(item, item) : { non-fluent, bool, default = false };
    W(color) : { non-fluent, real, default = 0.25 };
    x(item) : { state-fluent, real, default = 0.5 };
    m(item, item) : { state-fluent, real, default = 0.1 };
    k(item) : { state-fluent, int, default = 2 };
    b(item) : { state-fluent, bool, default = true };
    c(item) : { state-fluent, color, default = @green };
    who(item) : { state-fluent, item };
    s : { state-fluent, real, default = 1.0 };
    push(item) : { action-fluent, real, default = 0.0 };
    set(item) : { action-fluent, bool, default = false };
    paint(item) : { action-fluent, color, default = @red };
    y(item) : { interm-fluent, real };
    n(item) : { interm-fluent, int };
    t(item) : { interm-fluent, bool };
    q(item) : { interm-fluent, color };
    TRIALS : { non-fluent, int, default = 5 };
    h(color) : { interm-fluent, int };
  };
"""


def toy(reward: str, cpfs: str = "", **parts: str) -> str:
    """A domain whose reward, or one of whose fluents, is what a test is about."""
    own = {
        "y(?i)": "0.0",
        "n(?i)": "0",
        "t(?i)": "false",
        "q(?i)": "@red",
        "h(?c)": "0",
        "x'(?i)": "x(?i) + push(?i)",
        "m'(?i, ?j)": "m(?i, ?j) + 0.1 * push(?i) * A(?j)",
        "k'(?i)": "if (set(?i)) then k(?i) + 1 else k(?i) - 1",
        "b'(?i)": "b(?i) <=> ~set(?i)",
        "c'(?i)": "paint(?i)",
        "who'(?i)": "who(?i)",
        "s'": "s + sum_{?i: item} [push(?i)]",
    }
    for line in filter(None, (each.strip() for each in cpfs.split(";"))):
        name, _, value = line.partition("=")
        own[name.strip()] = value.strip()
    rules = "".join(f"{name} = {value};\n" for name, value in own.items())
    blocks = "".join(f"{name.replace('_', '-')} {{ {text} }};\n" for name, text in parts.items())
    return (
        f"domain toy {{ {FLUENTS} cpfs {{ {rules} }};\n reward = {reward}; {blocks} }}\n"
        "non-fluents nf { domain = toy; objects { item : {i1, i2, i3}; };\n"
        "  non-fluents { A(i2) = 2.5; LINK(i1, i2); LINK(i2, i3); W(@blue) = 0.5; }; }\n"
        "instance one { domain = toy; non-fluents = nf; init-state { x(i2) = 1.25; k(i3) = 5;\n"
        "  ~b(i2); c(i1) = @blue; who(i1) = @i2; who(i2) = @i2; who(i3) = @i1;\n"
        "  m(i1, i1) = 2.0; m(i2, i2) = 3.0; m(i3, i3) = 1.0; };\n"
        "  max-nondef-actions = pos-inf; horizon = 6; discount = 0.9; }\n"
    )


EXPRESSIONS = {
    "arithmetic": ("sum_{?i: item} [x(?i) * A(?i) - k(?i) / 4 + b(?i) * 2]", ""),
    "bools as numbers": ("(sum_{?i: item} [b(?i)]) + (prod_{?i: item} [k(?i)]) * (s > 1)", ""),
    "quantifiers": (
        "(exists_{?i: item} [b(?i) ^ x(?i) > 1]) + (forall_{?i: item} [b(?i) | k(?i) > 1])",
        "",
    ),
    "related pairs": ("sum_{?i: item, ?j: item} [LINK(?i, ?j) * x(?j) * k(?i)]", ""),
    "pairs": ("sum_{?i: item, ?j: item} [if (?i ~= ?j) then m(?i, ?j) else 0]", ""),
    "diagonal and transposed": ("sum_{?i: item, ?j: item} [m(?j, ?i) + m(?i, ?i) * x(?j)]", ""),
    "an eliminated variable": (
        "sum_{?i: item, ?j: item} [b(?i) * (k(?j) > 2) * (k(?i) + 1)]",
        "t(?i) = exists_{?j: item, ?k: item} [b(?j) ^ LINK(?j, ?i) ^ ~b(?k)]",
    ),
    "extrema": ("(max_{?i: item} [x(?i)]) - (min_{?i: item} [k(?i)]) + avg_{?i: item} [k(?i)]", ""),
    "where the maximum is": ("s", "who'(?i) = argmax_{?j: item} [x(?j)]"),
    "where the minimum is": ("s", "who'(?i) = argmin_{?j: item} [m(?i, ?j)]"),
    "a long sum": (
        "sum_{?i: item, ?j: item, ?k: item} [m(?i, ?j) * x(?k) / 3.7]",
        "y(?i) = sum_{?j: item, ?k: item} [m(?i, ?j) / (0.3 + x(?k) * x(?k))]",
    ),
    "objects as values": (
        "sum_{?i: item} [x(who(?i)) + (who(?i) == ?i)]",
        "who'(?i) = if (set(?i)) then ?i else who(?i); y(?i) = m(who(?i), who(who(?i)))",
    ),
    "colours as values": ("sum_{?i: item} [W(c(?i)) + (c(?i) == @blue)]", "y(?i) = W(@blue)"),
    "switch": (
        "sum_{?i: item} [switch(c(?i)) { case @red : x(?i), case @blue : 2, default : k(?i) }]",
        "",
    ),
    "conditions": ("sum_{?i: item} [if (b(?i)) then x(?i) else k(?i)]", "t(?i) = ~b(?i) | s < 2"),
    "implications": ("sum_{?i: item} [(b(?i) => x(?i) > 1) + (b(?i) <=> set(?i))]", ""),
    "rounding": (
        "sum_{?i: item} [round[x(?i) * 3] + floor[-x(?i)] + ceil[x(?i)] + sgn[x(?i) - 1]]",
        "n(?i) = div[k(?i) - 4, 3] + mod[k(?i) - 4, 3]; y(?i) = fmod[x(?i), 0.4]",
    ),
    "division by zero": ("s", "n(?i) = div[k(?i), k(?i) - 2] + mod[k(?i), k(?i) - 2]"),
    "not finite": ("sum_{?i: item} [0 * ln[k(?i) - k(?i)]]", "y(?i) = x(?i) / (k(?i) - 2)"),
    "functions": (
        "sum_{?i: item} [hypot[x(?i), k(?i)] + log[A(?i), 2] + exp[-x(?i)] + sqrt[A(?i)]]",
        "y(?i) = sin[x(?i)] + cos[s] + tan[s] + atan[s] + tanh[s] + lngamma[A(?i)] + gamma[2.5]",
    ),
    "determinant": ("det_{?i: item, ?j: item} [m(?i, ?j)]", ""),
    "inverse": ("s", "m'(?i, ?j) = inverse[row=?i, col=?j] [m(?i, ?j)]"),
    "terminations": ("s", "", {"termination": "s > 1.3;"}),
    "invariants": ("s", "", {"state_invariants": "s < 1.5; forall_{?i: item} [k(?i) > 0];"}),
    "preconditions": ("s", "", {"action_preconditions": "(sum_{?i: item} [set(?i)]) <= 1;"}),
}
DRAWS = {
    "Bernoulli": ("s", "t(?i) = Bernoulli(0.3 + 0.1 * b(?i))"),
    "Normal": ("s", "y(?i) = Normal(x(?i), A(?i))"),
    "Uniform": ("s", "y(?i) = Uniform(x(?i), x(?i) + 2)"),
    "Poisson": ("s", "n(?i) = Poisson(A(?i) * 2)"),
    "Exponential": ("s", "y(?i) = Exponential(A(?i))"),
    "Weibull": ("s", "y(?i) = Weibull(A(?i), 2.0)"),
    "Gamma": ("s", "y(?i) = Gamma(A(?i), 2.0)"),
    "Binomial": ("s", "n(?i) = Binomial(k(?i) + 9, 0.4)"),
    "NegativeBinomial": ("s", "n(?i) = NegativeBinomial(3, 0.4)"),
    "Beta": ("s", "y(?i) = Beta(A(?i), 2.0)"),
    "Geometric": ("s", "n(?i) = Geometric(0.3)"),
    "Pareto": ("s", "y(?i) = Pareto(A(?i), 2.0)"),
    "Student": ("s", "y(?i) = Student(A(?i) + 3)"),
    "Gumbel": ("s", "y(?i) = Gumbel(x(?i), A(?i))"),
    "Laplace": ("s", "y(?i) = Laplace(x(?i), A(?i))"),
    "Cauchy": ("s", "y(?i) = Cauchy(x(?i), A(?i))"),
    "Gompertz": ("s", "y(?i) = Gompertz(A(?i), 2.0)"),
    "ChiSquare": ("s", "y(?i) = ChiSquare(A(?i))"),
    "Kumaraswamy": ("s", "y(?i) = Kumaraswamy(A(?i), 2.0)"),
    "Discrete": ("s", "q(?i) = Discrete(color, @red : 0.2, @green : 0.5, @blue : 0.3)"),
    "UnnormDiscrete": ("s", "q(?i) = UnnormDiscrete(color, @red : 1, @green : k(?i), @blue : 3)"),
    "Discrete of a fluent": ("s", "q(?i) = Discrete_{?c: color} [W(?c)]"),
    "in a sum": ("sum_{?i: item, ?j: item} [LINK(?i, ?j) * Normal(x(?i), 1)]", ""),
    "MultivariateNormal": ("s", "y(?i) = MultivariateNormal[?i] (x(_), m(_, _))"),
    "MultivariateStudent": ("s", "y(?i) = MultivariateStudent[?i] (x(_), m(_, _), s)"),
    "Multinomial": ("s", "h(?c) = Multinomial[?c] (TRIALS, W(_))"),
    "Dirichlet": ("s", "y(?i) = Dirichlet[?i] (A(_))"),
}


@pytest.mark.parametrize("name", [*EXPRESSIONS, *DRAWS])
def test_all_is_as_in_the_environment(name):
    reward, cpfs, *blocks = (EXPRESSIONS | DRAWS)[name]
    problem = problem_from(toy(reward, cpfs, **(blocks[0] if blocks else {})))
    for quantile in QUANTILES if name in DRAWS else QUANTILES[:1]:
        found = compare(problem, quantile, is_random=True)
        assert found.differences == []
        assert found.steps >= 3
        assert found.draws == (name in DRAWS)


@pytest.mark.parametrize("name", DRAWS)
def test_draws_follow_the_environments_law(name):
    reward, cpfs = DRAWS[name]
    problem = problem_from(toy(reward, cpfs))
    fluent = cpfs.split("(")[0] if cpfs else "the reward"
    simulator, env = Simulator(problem), make_environment(problem)
    step = simulator.step(simulator.initial(3000), {}, np.random.default_rng(0))
    ours = step.rewards[None] if not cpfs else step.state[fluent].reshape(-1, 3000)
    theirs = []
    for seed in range(400):
        env.reset(seed=seed)
        reward = env.step({})[1]
        theirs.append(np.ravel(env.sampler.subs[fluent]) if cpfs else [reward])
    for mine, its in zip(ours, np.array(theirs, float).T, strict=True):
        assert stats.ks_2samp(mine, its).pvalue > 1e-4


def test_the_draws_of_replicas_and_objects_are_independent():
    problem = problem_from(toy("s", "y(?i) = Normal(0, 1); x'(?i) = y(?i)"))
    simulator = Simulator(problem)
    step = simulator.step(simulator.initial(5000), {}, np.random.default_rng(0))
    assert np.array_equal(step.state["y"], step.state["x"])
    assert np.abs(np.corrcoef(step.state["x"]) - np.eye(3)).max() < 0.06


@pytest.mark.parametrize(
    ("expression", "chance"),
    [
        ("Bernoulli(0.5) ^ Bernoulli(0.5)", 0.25),
        ("if (Bernoulli(0.5)) then Bernoulli(0.5) else false", 0.25),
        ("if (b(?i)) then Bernoulli(0.3) else Bernoulli(0.6) ^ Bernoulli(0.5)", 0.3),
        ("(if (b(?i)) then Bernoulli(0.5) else Bernoulli(0.9)) <=> Bernoulli(0.5)", 0.5),
        ("(if (b(?i)) then Bernoulli(0.5) else true) ^ (b(?i) => Bernoulli(0.5))", 0.25),
    ],
)
def test_draws_of_one_expression_are_independent(expression, chance):
    # exclusive branches are made of the same numbers, and nothing else is
    simulator = Simulator(problem_from(toy("s", f"t(?i) = {expression}")))
    state = dict(simulator.initial(20_000))
    state["b"] = np.ones((3, 20_000), bool)
    drawn = simulator.step(state, {}, np.random.default_rng(0)).state["t"]
    assert drawn.mean() == pytest.approx(chance, abs=4 * 0.5 / np.sqrt(drawn.size))


def test_an_error_is_its_replicas_own():
    problem = problem_from(toy("s", "t(?i) = Bernoulli(0.5 + push(?i))"))
    simulator = Simulator(problem)
    push = np.zeros((3, 4))
    push[1, 2] = 0.6  # a probability of 1.1
    step = simulator.step(simulator.initial(4), {"push": push}, np.random.default_rng(0))
    assert step.errors.tolist() == [False, False, True, False]
    assert step.rewards.tolist() == [1.0, 1.0, 0.0, 1.0]


@pytest.mark.parametrize(
    "expression",
    [
        "if (b(?i)) then Bernoulli(0.1 * k(?i)) else false",
        "b(?i) ^ Bernoulli(0.1 * k(?i))",
        "~b(?i) | Bernoulli(0.1 * k(?i))",
        "(b(?i) * Poisson(9 - k(?i))) > 1",
    ],
)
def test_what_the_environment_skips_raises_no_error(expression):
    problem = problem_from(toy("s", f"t(?i) = {expression}"))
    simulator = Simulator(problem)
    state = dict(simulator.initial(2))
    state["k"] = np.full((3, 2), 20)
    state["b"] = np.array([[True, False]] * 3)
    step = simulator.step(state, {}, np.random.default_rng(0))
    assert step.errors.tolist() == [True, False]


def test_what_is_not_finite_stays_in_its_replica():
    problem = problem_from(toy("sum_{?i: item} [ln[x(?i)] + sum_{?j: item} [A(?j) * x(?i)]]"))
    simulator = Simulator(problem)
    state = dict(simulator.initial(3))
    state["x"] = np.array([[1.0, 0.0, 1.0]] * 3)
    step = simulator.step(state, {}, np.random.default_rng(0))
    assert np.isfinite(step.rewards).tolist() == [True, False, True]


def test_blocks_are_as_one():
    problem = problem_from(toy("sum_{?i: item} [x(?i)]", "y(?i) = x(?i) * A(?i)"))
    simulator = Simulator(problem)
    push = np.random.default_rng(0).random((3, 10))
    whole = simulator.step(simulator.initial(10), {"push": push}, np.random.default_rng(0))
    simulator.block = 4
    parts = simulator.step(simulator.initial(10), {"push": push}, np.random.default_rng(0))
    assert np.array_equal(whole.rewards, parts.rewards)
    assert all(np.array_equal(whole.state[name], parts.state[name]) for name in whole.state)


def test_a_step_leaves_the_state_that_it_was_given():
    problem = problem_from(toy("sum_{?i: item} [x(?i) + 1 - x(?i) * 2]"))
    simulator = Simulator(problem)
    state = simulator.step(simulator.initial(5), {"push": 1.0}, np.random.default_rng(0)).state
    before = {name: value.copy() for name, value in state.items()}
    again = [simulator.step(state, {"push": 1.0}, np.random.default_rng(1)) for _ in range(2)]
    assert all(np.array_equal(before[name], state[name]) for name in before)
    assert np.array_equal(again[0].rewards, again[1].rewards)


def test_a_state_may_be_given_in_other_types():
    simulator = Simulator(problem_from(toy("sum_{?i: item} [x(?i) * 2 + 0.5]")))
    state = dict(simulator.initial(2))
    state["x"] = np.ones((3, 2), int)
    step = simulator.step(state, {"push": np.ones(3)[:, None]}, np.random.default_rng(0))
    assert step.rewards.tolist() == [7.5, 7.5]
    assert step.state["x"].tolist() == [[2.0, 2.0]] * 3


def test_actions_can_be_written_over_after_the_step():
    simulator = Simulator(problem_from(toy("s")))
    paint = np.full((3, 2), 2)
    state = simulator.step(simulator.initial(2), {"paint": paint}, np.random.default_rng(0)).state
    paint[...] = 0
    assert state["c"].tolist() == [[2, 2]] * 3


def test_limits_on_actions_are_a_mask():
    text = toy("s").replace("max-nondef-actions = pos-inf", "max-nondef-actions = 1")
    simulator = Simulator(problem_from(text))
    one_more = {"set": np.array([[True, True]] * 1 + [[False, True]] * 2)}
    assert simulator.legal(simulator.initial(2), one_more).tolist() == [True, False]
