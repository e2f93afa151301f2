"""What a summary says of the policy and of its noise."""

import pytest
from helpers.config_texts import TEXT
from helpers.umbrella import careless, voting

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.session.report.summary import planner_figures, policy_figures, title


@pytest.mark.parametrize(
    ("section", "noise", "parameters"),
    [
        # the planner's default, of which the configuration says nothing
        (
            "",
            "constant, beside updates without",
            {"sigma": 0.1, "unit": "range", "paired": True},
        ),
        ("[Noise]\nmethod='ConstantNoise'\nsigma=2\n", "constant", {"sigma": 2}),
        (
            "[Noise]\nmethod='AnnealedNoise'\ncycle=9\n",
            "AnnealedNoise, beside updates without",
            {"cycle": 9},
        ),
        ("[Noise]\nmethod='NoNoise'\n", "none", {}),
    ],
)
def test_the_noise_is_told_from_noise_in_all_updates(section, noise, parameters):
    config = PlannerConfig.from_text(TEXT + section)
    figures = planner_figures(config)
    assert (figures["noise"], figures["noise_parameters"]) == (noise, parameters)
    head = title({**figures, "label": "a", "horizon": 3, "seed": 0, "policy": "slp"})
    assert head == f"a (H = 3), slp, {noise} noise, seed 0"


def test_a_policy_that_votes_is_called_so():
    assert policy_figures(voting())["policy"] == "vote over a belief"
    assert policy_figures(careless())["policy"] == "feedback"
