"""Every distribution of RDDL in the ground model: worked by hand, and the environment's."""

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import open_model
from mdpo_rddl.problem.enumeration.sampling import GroundSampler
from mdpo_rddl.problem.load import make_environment

MODEL = """domain draws {
  types { color : {@red, @green, @blue}; };
  pvariables {
    W(color) : { non-fluent, real, default = 0.25 };
    n : { state-fluent, int, default = 2 };
    c : { state-fluent, color, default = @red };
    x : { action-fluent, bool, default = false };
  };
  cpfs { n' = NUMBER; c' = COLOR; };
  reward = n;
}
non-fluents nf { domain = draws; non-fluents { W(@blue) = 0.5; }; }
instance one { domain = draws; non-fluents = nf; max-nondef-actions = 1; horizon = 3;
  discount = 1.0; }
"""
NUMBERS = {
    "Bernoulli(0.3)": {0: 0.7, 1: 0.3},
    "Bernoulli(0.0)": {0: 1.0},
    "Bernoulli(1.0)": {1: 1.0},
    "KronDelta(4)": {4: 1.0},
    "Bernoulli(0.5) + Bernoulli(0.5)": {0: 0.25, 1: 0.5, 2: 0.25},
    "if (Bernoulli(0.2)) then 3 else KronDelta(1)": {1: 0.8, 3: 0.2},
    "Bernoulli(n / 8) * n": {0: 0.75, 2: 0.25},
}
COLORS = {
    "Discrete(color, @red : 0.2, @green : 0.5, @blue : 0.3)": {0: 0.2, 1: 0.5, 2: 0.3},
    "Discrete(color, @red : 0.0, @green : 1.0, @blue : 0.0)": {1: 1.0},
    "UnnormDiscrete(color, @red : 1, @green : n, @blue : 1)": {0: 0.25, 1: 0.5, 2: 0.25},
    "Discrete_{?c: color} [W(?c)]": {0: 0.25, 1: 0.25, 2: 0.5},
    "UnnormDiscrete_{?c: color} [W(?c) * 3]": {0: 0.25, 1: 0.25, 2: 0.5},
}
# drawn values that are too many to be enumerated, or no whole numbers
REFUSED = [
    "Poisson(2.0)",
    "Binomial(3, 0.5)",
    "NegativeBinomial(3, 0.5)",
    "Geometric(0.5)",
    "round[Normal(0.0, 1.0)]",
    "round[Uniform(0.0, 1.0)]",
    "round[Exponential(1.0)]",
    "round[Weibull(1.0, 1.0)]",
    "round[Gamma(1.0, 1.0)]",
    "round[Beta(1.0, 1.0)]",
    "round[Pareto(2.0, 1.0)]",
    "round[Student(3.0)]",
    "round[Gumbel(0.0, 1.0)]",
    "round[Laplace(0.0, 1.0)]",
    "round[Cauchy(0.0, 1.0)]",
    "round[Gompertz(1.0, 1.0)]",
    "round[ChiSquare(1.0)]",
    "round[Kumaraswamy(1.0, 1.0)]",
]
SAMPLES, EPISODES = 20_000, 400
LIMITS = EnumerationLimits(1e9)


def problem(number="n", color="c"):
    return problem_from(MODEL.replace("NUMBER", number).replace("COLOR", color))


@pytest.mark.parametrize("expression", [*NUMBERS, *COLORS])
def test_the_law_is_that_of_the_environment(expression):
    is_number = expression in NUMBERS
    posed = problem(number=expression) if is_number else problem(color=expression)
    right = (NUMBERS | COLORS)[expression]
    model = open_model(posed, LIMITS)
    sampler, generator = GroundSampler(model), np.random.default_rng(0)
    names = [name for name, _ in model.variables]
    row = names.index("n" if is_number else "c")
    states = np.zeros((len(names), SAMPLES))
    states[names.index("n")] = 2
    uniform = generator.random((sampler.draws, SAMPLES))
    ours = sampler.step(states, np.zeros((1, SAMPLES)), uniform).states[row]
    env, theirs = make_environment(posed), []
    for seed in range(EPISODES):
        env.reset(seed=seed)
        env.step({})
        theirs.append(int(env.sampler.subs["n'" if is_number else "c'"]))
    for value in {*ours.tolist(), *theirs, *right}:
        chance = right.get(int(value), 0.0)
        spread = np.sqrt(chance * (1.0 - chance))
        assert np.mean(ours == value) == pytest.approx(chance, abs=5 * spread / SAMPLES**0.5)
        share = np.mean(np.array(theirs) == value)
        assert share == pytest.approx(chance, abs=5 * spread / EPISODES**0.5)


@pytest.mark.parametrize("expression", REFUSED)
def test_what_cannot_be_enumerated_is_refused(expression):
    with pytest.raises(NotEnumerableError):
        open_model(problem(number=expression), LIMITS)
