"""Every distribution of RDDL in the exact model, at its edges too: the environment's law."""

import jax
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import problem_from
from scipy import stats

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.planner.upstream import INVALID_PARAMETERS
from mdpo_rddl.problem.load import make_environment

DRAWS = 2000
# below what the fixed keys of laws that agree come to, and far above those that do not
LEAST_P = 1e-4
# beyond these a single-precision number has no more
DECIMALS = 4

LAWS = {
    "Uniform": [(-1.0, 2.0), (1.0, 1.0)],
    "Normal": [(1.0, 4.0), (0.5, 0.0)],
    "Exponential": [(0.5,), (0.001,)],
    "Weibull": [(0.5, 2.0), (3.0, 1.0)],
    "Gamma": [(0.02, 2.0), (0.5, 1.0), (30.0, 0.1)],
    "Beta": [(0.02, 0.03), (0.5, 0.5), (2.0, 3.0)],
    "Pareto": [(3.0, 10.0), (0.5, 1.0), (20.0, 0.1)],
    "Student": [(0.3,), (3.0,)],
    "Gumbel": [(1.0, 2.0)],
    "Laplace": [(1.0, 2.0)],
    "Cauchy": [(1.0, 2.0)],
    "Gompertz": [(0.1, 2.0), (3.0, 0.5)],
    "ChiSquare": [(0.04,), (1.0,), (30.0,)],
    "Kumaraswamy": [(0.1, 0.1), (2.0, 3.0)],
    "Bernoulli": [(0.0,), (1.0,), (0.3,)],
    "Poisson": [(0.0,), (0.3,), (10.0,), (200.0,)],
    "Binomial": [(0, 0.5), (5, 0.0), (5, 1.0), (10, 0.3), (1000, 0.4)],
    "NegativeBinomial": [(2.5, 0.3), (1.0, 1.0), (0.2, 0.5), (40.0, 0.2)],
    "Geometric": [(1.0,), (0.3,), (0.001,)],
    "KronDelta": [(4,)],
    "DiracDelta": [(0.5,)],
}
"""Per law the parameters to try."""
OTHERS = {
    "a mean of all": "Normal(MEAN, SPREAD(?o))",
    "a variance of all": "Normal(SPREAD(?o), MEAN)",
    "bounds of all": "Uniform(MEAN, 2.0)",
    "constants": "Weibull(1.5, 2.0)",
    "a shape of all": "Pareto(SHAPE, SPREAD(?o))",
    "a scale of all": "Gompertz(SPREAD(?o), SHAPE)",
    "a sum": "sum_{?k : kind} [Weibull(2.0, 1.0)]",
    "a bool": "Bernoulli(MEAN) + 0.0",
    "Discrete": "if (Discrete(kind, @k1 : 0.0, @k2 : 0.75, @k3 : 0.25) == @k2) then 1.0 else 0.0",
    "UnnormDiscrete": "if (UnnormDiscrete(kind, @k1 : 0.0, @k2 : SPREAD(?o), @k3 : 1.0) == @k2)"
    " then 1.0 else 0.0",
    "Discrete(p)": "if (@k2 == Discrete_{?k : kind} [THIRD(?o, ?k)]) then 1.0 else 0.0",
    "UnnormDiscrete(p)": "if (@k2 == UnnormDiscrete_{?k : kind} [LEVEL(?o, ?k)]) then 1.0 else 0.0",
}
VECTORS = {
    "MultivariateNormal": "MultivariateNormal[?k](LEVEL(?o, _), COVARIANCE(?o, _, _))",
    "MultivariateStudent": "MultivariateStudent[?k](LEVEL(?o, _), COVARIANCE(?o, _, _), FREE(?o))",
    "Dirichlet": "Dirichlet[?k](LEVEL(?o, _))",
    "Dirichlet of small ones": "Dirichlet[?k](SMALL(?o, _))",
    "Multinomial": "Multinomial[?k](TRIALS, THIRD(?o, _))",
    "Multinomial of one kind": "Multinomial[?k](TRIALS, ONE(?o, _))",
}
MODEL = """domain laws {
    types { thing : object; kind : {@k1, @k2, @k3}; };
    pvariables {
        ENTRY(kind, kind) : { non-fluent, real, default = 0.5 };
        THIRD(thing, kind) : { non-fluent, real, default = 0.3333333333333333 };
        LEVEL(thing, kind) : { non-fluent, real, default = 2.0 };
        SMALL(thing, kind) : { non-fluent, real, default = 0.02 };
        FREE(thing) : { non-fluent, real, default = 3.0 };
        TRIALS : { non-fluent, int, default = 7 };
        MEAN : { state-fluent, real, default = 0.5 };
        SHAPE : { state-fluent, real, default = 3.0 };
        SPREAD(thing) : { state-fluent, real, default = 2.0 };
        COVARIANCE(thing, kind, kind) : { interm-fluent, real };
        ONE(thing, kind) : { interm-fluent, real };
        FLUENTS
        x : { action-fluent, bool, default = false };
    };
    cpfs {
        MEAN' = MEAN; SHAPE' = SHAPE; SPREAD'(?o) = SPREAD(?o);
        COVARIANCE(?o, ?k, ?l) = ENTRY(?k, ?l) * SPREAD(?o);
        ONE(?o, ?k) = ?k == @k2;
        CPFS
    };
    reward = 0.0;
}
non-fluents n {
    domain = laws; objects { thing : {THINGS}; };
    non-fluents { ENTRY(@k1, @k1) = 2.0; ENTRY(@k2, @k2) = 1.0; ENTRY(@k3, @k3) = 3.0; };
}
instance i {
    domain = laws; non-fluents = n; max-nondef-actions = 1; horizon = 2; discount = 1.0;
}
"""
NO_LAW = {
    "Uniform": (2.0, 1.0),
    "Normal": (0.0, -1.0),
    "Exponential": (0.0,),
    "Weibull": (-1.0, 1.0),
    "Gamma": (0.0, 1.0),
    "Beta": (1.0, 0.0),
    "Pareto": (2.0, 0.0),
    "Student": (0.0,),
    "Gumbel": (0.0, 0.0),
    "Laplace": (0.0, -1.0),
    "Cauchy": (0.0, 0.0),
    "Gompertz": (1.0, 0.0),
    "ChiSquare": (0.0,),
    "Kumaraswamy": (0.0, 1.0),
    "Bernoulli": (1.5,),
    "Poisson": (-0.5,),
    "Binomial": (-1, 0.5),
    "NegativeBinomial": (2.0, 0.0),
    "Geometric": (0.0,),
}
"""Per law parameters that the environment refuses."""
FORMER = """domain former {
    pvariables {
        FLUENTS
        drawn : { state-fluent, real, default = 0.0 };
        x : { action-fluent, bool, default = false };
    };
    cpfs { CPFS };
    reward = drawn;
}
non-fluents n { domain = former; }
instance i {
    domain = former; non-fluents = n; max-nondef-actions = 1; horizon = 3; discount = 1.0;
}
"""


def exact_model(problem):
    return build_planner(problem, without_scales(preset(1.0))).planner.test_compiled


def parameters_of(name, number, values):
    """Fluents that hold a law's parameters: their declarations, what keeps them, the arguments."""
    names = [f"P{number}_{k}" for k in range(len(values))]
    kinds = ["int" if isinstance(value, int) else "real" for value in values]
    declared = [
        f"{own}(thing) : {{ state-fluent, {kind}, default = {value} }};"
        for own, kind, value in zip(names, kinds, values, strict=True)
    ]
    kept = [f"{own}'(?o) = {own}(?o);" for own in names]
    return declared, kept, f"{name}({', '.join(f'{own}(?o)' for own in names)})"


def test_they_are_the_environment_s():
    fluents, cpfs, drawn = [], [], []
    for name, tries in LAWS.items():
        for values in tries:
            number = len(drawn)
            declared, kept, law = parameters_of(name, number, values)
            fluents += declared
            cpfs += [*kept, f"drawn{number}'(?o) = {law} + 0.0;"]
            drawn.append(f"{name}{values}")
    for name, expression in OTHERS.items():
        cpfs.append(f"drawn{len(drawn)}'(?o) = {expression};")
        drawn.append(name)
    scalars = len(drawn)
    for name, expression in VECTORS.items():
        cpfs.append(f"drawn{len(drawn)}'(?o, ?k) = {expression};")
        drawn.append(name)
    fluents += [
        f"drawn{k}({'thing' if k < scalars else 'thing, kind'})"
        " : { state-fluent, real, default = 0.0 };"
        for k in range(len(drawn))
    ]
    things = ", ".join(f"o{k}" for k in range(DRAWS))
    parts = {"FLUENTS": "\n".join(fluents), "CPFS": "\n".join(cpfs), "THINGS": things}
    text = MODEL
    for word, part in parts.items():
        text = text.replace(word, part)
    problem = problem_from(text)
    env, model = make_environment(problem), exact_model(problem)
    env.reset(seed=0)
    theirs = env.step({})[0]
    transition = jax.jit(model.compile_transition(check_constraints=False, cache_path_info=False))
    given = {"x": np.zeros((), bool)}, *model.split_fluent_nonfluent(model.init_values), {}
    ours, log, _ = transition(jax.random.PRNGKey(0), *given)
    assert int(log["error"]) & INVALID_PARAMETERS == 0
    wrong = []
    for k, name in enumerate(drawn):
        pairs = [
            (function(ours[f"drawn{k}"]), function(theirs[f"drawn{k}"]))
            for function in _views(vector=k >= scalars)
        ]
        if not all(map(_agree, *zip(*pairs, strict=True))):
            wrong.append(name)
    assert wrong == []


def _views(vector):
    """Numbers [DRAWS] that a law's draws come to; of a vector also what its entries share."""
    if not vector:
        return [np.asarray]
    weights = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 0), (0, 1, 1), (1, 0, -1)]
    return [lambda draws, of=of: np.asarray(draws, float) @ np.array(of) for of in weights]


def _agree(ours, theirs):
    rounded = [np.round(np.asarray(each, float), DECIMALS) for each in (ours, theirs)]
    return stats.ks_2samp(*rounded, method="asymp").pvalue > LEAST_P


@pytest.mark.parametrize("name", NO_LAW)
def test_what_the_environment_refuses_is_an_error(name):
    good, bad = LAWS[name][-1], NO_LAW[name]
    kinds = ["int" if isinstance(value, int) else "real" for value in good]
    names = [f"P{k}" for k in range(len(good))]
    fluents = [
        f"{own} : {{ state-fluent, {kind}, default = {value} }};"
        for own, kind, value in zip(names, kinds, good, strict=True)
    ]
    cpfs = [f"{own}' = {value};" for own, value in zip(names, bad, strict=True)]
    cpfs.append(f"drawn' = {name}({', '.join(names)}) + 0.0;")
    text = FORMER.replace("FLUENTS", "\n".join(fluents)).replace("CPFS", "\n".join(cpfs))
    problem = problem_from(text)
    env, model = make_environment(problem), exact_model(problem)
    env.reset(seed=0)
    env.step({})
    with pytest.raises(Exception, match=r"(?i)must|invalid|p "):
        env.step({})
    transition = model.compile_transition(check_constraints=False, cache_path_info=False)
    initial, nonfluents = model.split_fluent_nonfluent(model.init_values)
    refused = {own: np.array(value) for own, value in zip(names, bad, strict=True)}
    for values, is_law in ((initial, True), ({**initial, **refused}, False)):
        given = {"x": np.zeros((), bool)}, values, nonfluents, {}
        _, log, _ = transition(jax.random.PRNGKey(0), *given)
        assert (int(log["error"]) & INVALID_PARAMETERS == 0) == is_law
