"""Constants in batches: what they show of chance, and how much memory and time that takes."""

import jax
import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset, write_lake
from helpers.probes import probed

from mdpo_rddl.auto.common import sizes
from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.sizes import Batches
from mdpo_rddl.auto.probing import constants, probing
from mdpo_rddl.auto.probing.constants import Constants
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.exact import Visits, visit_bytes

STEPS = 8


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    lake = write_lake(tmp_path_factory.mktemp("lake"))
    return build_planner(lake, without_scales(preset(1.0))).planner


class Model:
    """In place of the compiled one: the return and the depths are functions of action and chance.

    Attributes:
      batches: sizes of those that were played.
      takes: seconds of each batch.
    """

    def __init__(self, monkeypatch, returned, depth, clock=None):
        self._returned, self._depth, self._clock = returned, depth, clock
        self.batches, self.takes = [], 0.0
        monkeypatch.setattr(constants, "compile_visits", self._compile)

    def _compile(self, planner, rollouts, side_by_side=None, jit=None):
        def play(key, params):
            pump = np.asarray(params["own"]["pump"]["bias"], np.float32).reshape(-1, 1)
            chance = np.asarray(jax.random.normal(key, (1, rollouts)), np.float32)
            self.batches.append(len(pump))
            if self._clock is not None:
                self._clock.now += self.takes
            depths = np.broadcast_to(self._depth(pump, chance), (len(pump), rollouts))
            depths = np.repeat(depths[:, :, np.newaxis], STEPS, axis=2)
            returns = np.broadcast_to(self._returned(pump, chance), (len(pump), rollouts))
            return Visits(returns, {"depth": depths})

        return play


@pytest.mark.parametrize(
    ("returned", "depth", "deterministic", "certain"),
    [
        # a reward that no constant finds, in a random state
        (lambda pump, chance: 0.0 * pump, lambda pump, chance: pump + chance, False, False),
        # what actions cost says nothing of the reward
        (lambda pump, chance: -abs(pump), lambda pump, chance: pump + chance, False, False),
        # and no constant says anything if nothing moves
        (lambda pump, chance: 0.0 * pump, lambda pump, chance: 0.0 * pump, False, False),
        # chance is elsewhere
        (lambda pump, chance: -abs(pump - 9), lambda pump, chance: chance, True, False),
        # or nowhere
        (lambda pump, chance: -abs(pump - 9), lambda pump, chance: pump, True, True),
        (lambda pump, chance: chance - abs(pump), lambda pump, chance: pump, False, False),
    ],
)
def test_chance_is_ruled_out_only_where_it_is_shown(
    planner, monkeypatch, returned, depth, deterministic, certain
):
    Model(monkeypatch, returned, depth)
    seen = probed(planner, 0)
    assert (seen.deterministic, seen.certain) == (deterministic, certain)
    # nothing is drawn
    monkeypatch.setattr(probing, "has_draws", lambda model: False)
    seen = probed(planner, 0)
    assert (seen.deterministic, seen.certain) == (True, True)


def test_what_is_seldom_drawn_is_looked_for_in_more_rollouts(planner, monkeypatch):
    def collides(pump, chance):
        return -abs(pump - 9) - (chance < -1.2)

    Model(monkeypatch, collides, lambda pump, chance: pump)
    assert not probed(planner, 0).deterministic
    # the first four have none
    monkeypatch.setattr(probing, "_CONFIRMING", 0)
    assert probed(planner, 0).deterministic


def test_one_rollout_shows_nothing_of_chance(planner, monkeypatch):
    Model(monkeypatch, lambda pump, chance: -abs(pump - 9), lambda pump, chance: pump)
    monkeypatch.setattr(probing, "is_large", lambda planner: True)
    assert not probed(planner, 0).deterministic


def test_the_best_of_many_constants_is_compared_in_other_rollouts(planner, monkeypatch):
    # each constant's return is another function of chance, none better than another
    def lucky(pump, chance):
        return -100.0 + 20.0 * np.sin(1e3 * (pump + chance))

    Model(monkeypatch, lucky, lambda pump, chance: pump)
    found = [probed(planner, seed) for seed in range(3)]
    # the best of all in four rollouts is 14 above on average
    assert np.mean([seen.start_return for seen in found]) < -100.0 + 7.0


def test_a_noop_that_is_the_best_is_told_by_other_rollouts_too(planner, monkeypatch):
    def best(pump, chance):
        return 50.0 * chance - 1000.0 * (pump != 0.0)

    Model(monkeypatch, best, lambda pump, chance: pump + chance)
    seen = probed(planner, 0)
    chosen_by = 50.0 * np.mean(jax.random.normal(key_for(Draws.PROBING, 0), (1, 4)))
    assert seen.noop_return == seen.start_return
    assert abs(seen.noop_return - chosen_by) > 1.0


def test_batches_and_what_is_kept_of_them_fit_into_memory(planner, monkeypatch):
    one = visit_bytes(planner)
    assert one == STEPS * 4
    for module in (constants, sizes):
        monkeypatch.setattr(module, "VISITS_BYTES", 6 * one)
    model = Model(monkeypatch, lambda pump, chance: pump + chance, lambda pump, chance: pump)
    kept = []
    scale = probing._scale
    monkeypatch.setattr(probing, "_scale", lambda values: kept.append(values) or scale(values))
    seen = probed(planner, 0)
    assert set(model.batches) == {1}  # of four rollouts
    (batches,) = kept
    assert len(batches) == 32
    assert 0 < sum(values.nbytes for values in batches) <= 32 * 4 * 4
    assert all(values.dtype == np.float32 for values in batches)
    assert seen.state_scales["depth"][1] > 0.0


def test_probing_ends_with_the_batch_in_which_its_time_is_over(planner, monkeypatch):
    clock = Stopped()
    model = Model(monkeypatch, lambda pump, chance: pump, lambda pump, chance: pump, clock)
    model.takes = 1.0
    played = Constants(planner, 0, Batches(32, 1, 2), until=3.0, clock=clock)
    bias = [{"pump": np.array(float(number))} for number in range(32)]
    # the first one, which compiles, is not counted
    means = played.means(bias)
    np.testing.assert_array_equal(means, [*range(8), *[-np.inf] * 24])
    assert clock.now == 4.0
    # but for those without which there is nothing
    means, states = played.means_and_states(bias, at_least=2)
    np.testing.assert_array_equal(means, [0.0, 1.0])
    assert [values.shape for values in states["depth"]] == [(2, 1, STEPS)]
    assert played.fresh_returns(bias[0], bias[1], 4).shape == (2, 0)
