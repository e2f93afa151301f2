"""A configuration to text and back, whatever values it holds."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.text import parse_sections

POSITIVE = st.floats(1e-12, 1e12)
COUNT = st.integers(1, 10**6)
SEVERAL = st.lists(COUNT, max_size=4)
# text is printed as Python writes it, so that any will do
TEXT = st.text(max_size=12)
LITERALS = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | TEXT,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.tuples(inner, inner)
        | st.dictionaries(TEXT, inner, max_size=3)
    ),
    max_leaves=8,
)


def some(**values):
    """A section with any of these keys."""
    return st.fixed_dictionaries({}, optional=values)


NOISES = st.one_of(
    st.builds(
        lambda low, span: {"method": "AdaptiveNoise", "sigma_min": low, "sigma_max": low + span},
        st.floats(0, 10),
        st.floats(0, 10),
    ),
    some(alpha=POSITIVE, quantile=st.floats(0.01, 1.0), analysis_samples=st.integers(0, 9)),
    st.builds(lambda sigma: {"method": "ConstantNoise", "sigma": sigma}, st.floats(0, 1e6)),
    st.just({"method": "NoNoise"}),
)
CONFIGS = st.fixed_dictionaries(
    {
        "Compiler": some(sigmoid_weight=POSITIVE, print_warnings=st.booleans()),
        "Planner": st.builds(
            lambda fixed, rest: fixed | rest,
            st.fixed_dictionaries(
                {
                    "method": st.sampled_from(["JaxStraightLinePlan", "JaxDeepReactivePolicy"]),
                    "optimizer": st.sampled_from(["rmsprop", "adam", "sgd"]),
                    "optimizer_kwargs": some(learning_rate=POSITIVE),
                    "pgpe": st.none(),
                }
            ),
            some(
                batch_size_train=COUNT,
                rollout_horizon=st.integers(1, 10**5) | st.none(),
                clip_grad=POSITIVE,
                utility=st.sampled_from(["mean", "cvar"]),
                utility_kwargs=some(alpha=POSITIVE),
            ),
        ),
        "Optimize": some(
            key=st.integers(0, 2**31 - 1),
            epochs=COUNT,
            train_seconds=POSITIVE,
            policy_hyperparams=st.floats(-1e9, 1e9) | st.dictionaries(TEXT, st.integers()),
            guess=LITERALS,
        ),
    },
    optional={
        "Noise": NOISES,
        "MDPO": some(stop_at_termination=st.booleans(), keep_group_limits=st.booleans()),
    },
)


@given(CONFIGS)
def test_a_configuration_comes_back_from_its_text(sections):
    config = PlannerConfig(sections, "drawn")
    again = PlannerConfig.from_text(config.to_text(), "drawn")
    assert again == config
    assert again.to_text() == config.to_text()
    assert again.noise() == config.noise()
    ours = {"Noise", "MDPO"}
    for_jaxplan = parse_sections(config.to_text(for_jaxplan=True), "drawn")
    assert for_jaxplan == {name: values for name, values in sections.items() if name not in ours}


@given(CONFIGS, st.sampled_from(["Compiler", "Planner", "Optimize"]), LITERALS)
def test_an_unknown_key_is_refused_by_name(sections, section, value):
    changed = {**sections, section: {**sections[section], "wieght": value}}
    text = PlannerConfig(changed, "drawn").to_text()
    with pytest.raises(InputError, match=rf"drawn: \[{section}\] unknown key 'wieght'"):
        PlannerConfig.from_text(text, "drawn")
