"""How the preset is fitted to a problem: a memory."""

import pytest
from helpers.clocks import Ticking
from helpers.lakes import PLAIN, preset, write_lake
from helpers.toys import toy

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.planner.config.fitting import MEMORY, with_memory


def test_a_policy_remembers_where_the_state_is_not_observed():
    fitted = with_memory(preset(1.0), toy("signal"))
    assert fitted.policy_arguments["memory"] == MEMORY
    others = {k: v for k, v in fitted.policy_arguments.items() if k != "memory"}
    assert others == preset(1.0).policy_arguments


def test_a_memory_that_is_given_stays():
    given = preset(1.0).with_policy_arguments(memory={})
    assert with_memory(given, toy("signal")) is given


def test_there_is_no_memory_where_the_state_is_observed(tmp_path):
    config = preset(1.0)
    assert with_memory(config, write_lake(tmp_path)) is config


@pytest.mark.slow
def test_a_race_finds_a_policy_that_no_memoryless_one_equals():
    config = preset(3000.0, without=[*PLAIN, "gradient"])
    outcome = plan_automatically(toy("signal"), config, 0, RaceOptions(clock=Ticking()))
    # two lamps: what is shown is known at one step, and a guess at the three after it
    assert outcome.chosen.known_mean > 2 * (1 + 3 * 0.5) + 1.0
    played = outcome.policy.evaluate(episodes=40)
    assert played.mean == pytest.approx(outcome.chosen.known_mean, abs=0.7)
