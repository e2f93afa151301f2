"""How the preset is fitted to a problem: a memory, and a layer that ppo can learn."""

from types import SimpleNamespace

import pytest
from helpers.clocks import Ticking
from helpers.lakes import PLAIN, preset, write_lake
from helpers.toys import toy

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.fitting import LIFTED_UNITS, MEMORY, with_lifted_layer, with_memory


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


def test_bools_have_a_hidden_layer_on_each_objects_features(tmp_path):
    config = preset(1.0)
    rules = {"RULES": "forall_{?a : arm} [pull(?a) => true];", "TERMINATION": "false"}
    lever = toy("lever", LIKELIHOOD="1.0", DISCOUNT="1.0", MOST="1", **rules)
    seen = SimpleNamespace(start_beats_noop=True)
    fitted = with_lifted_layer(config, lever, seen)
    assert fitted.policy_arguments["lifted"] == LIFTED_UNITS
    given = config.with_policy_arguments(lifted=0)
    assert with_lifted_layer(given, lever, seen) is given
    for other in (write_lake(tmp_path), toy("signal")):  # real actions; a state that is not seen
        assert with_lifted_layer(config, other, seen) is config
    rare = SimpleNamespace(start_beats_noop=False)  # ppo does not come first
    assert with_lifted_layer(config, lever, rare) is config


@pytest.mark.slow
def test_a_race_finds_a_policy_that_no_memoryless_one_equals():
    config = preset(3000.0, without=[*PLAIN, "gradient"])
    outcome = plan_automatically(toy("signal"), config, 0, RaceOptions(clock=Ticking()))
    # two lamps: what is shown is known at one step, and a guess at the three after it
    assert outcome.chosen.known_mean > 2 * (1 + 3 * 0.5) + 1.0
    played = outcome.policy.evaluate(episodes=40)
    assert played.mean == pytest.approx(outcome.chosen.known_mean, abs=0.7)
