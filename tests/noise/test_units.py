"""Noise in units of the action: what the unit is, and how it passes a squashing function."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.noise import AdaptiveNoise, AnnealedNoise, ConstantNoise
from mdpo_rddl.noise.actions import ActionKind, ActionSpec
from mdpo_rddl.noise.draws import draw_perturbation
from mdpo_rddl.noise.projection import perturb_and_project, squash_to_box, squashing_slope
from mdpo_rddl.noise.units import has_box, in_range_units


def spec(lower, upper, kind=ActionKind.REAL, **others) -> ActionSpec:
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    return ActionSpec("a", lower.shape, kind, lower, upper, **others)


def in_range(one: ActionSpec, scale: float = 1.0) -> ActionSpec:
    return in_range_units({"a": one}, {"a": scale})["a"]


def test_the_unit_is_the_width_of_each_object_s_box():
    assert in_range(spec([0.0, -3.0], [20.0, 3.0])).unit.tolist() == [20.0, 6.0]


def test_without_a_box_the_unit_is_what_the_return_answers_to():
    half_open = spec([0.0, 0.0], [np.inf, 8.0])
    assert not has_box(half_open)
    assert in_range(half_open, 30.0).unit.tolist() == [30.0, 8.0]


def test_a_plan_s_own_unit_stands_where_there_is_no_box():
    scaled = spec([-np.inf, 0.0], [np.inf, 8.0], unit=np.array([5.0, 4.0]))
    assert has_box(scaled)
    assert in_range(scaled, 30.0).unit.tolist() == [5.0, 8.0]


@pytest.mark.parametrize("kind", [ActionKind.BOOL, ActionKind.CHOICE])
def test_bools_keep_the_scale_of_their_logits(kind):
    bools = spec([np.nan], [np.nan], kind)
    assert has_box(bools)
    assert in_range(bools, 30.0) is bools


def test_an_action_that_can_only_be_one_value_has_unit_1():
    assert in_range(spec([2.0], [2.0])).unit.tolist() == [1.0]


def test_the_same_sigma_is_the_same_share_of_every_range():
    specs = in_range_units({"a": spec([0.0, 0.0], [400.0, 2.0])}, {})
    draws = draw_perturbation(jax.random.PRNGKey(0), jnp.full(3, 0.1), specs, 4000, jnp.float32)
    np.testing.assert_allclose(np.std(draws["a"], axis=(0, 1)), [40.0, 0.2], rtol=0.03)


BOXES = {"both": ([1.0], [9.0]), "lower": ([1.0], [np.inf]), "upper": ([-np.inf], [9.0])}


@pytest.mark.parametrize("box", [*BOXES.values(), ([-np.inf], [np.inf])])
@pytest.mark.parametrize("raw", [-1.5, 0.0, 1.2])
def test_the_slope_is_the_squashing_function_s_derivative(box, raw):
    squashed = spec(*box, squashed=True)
    derivative = jax.grad(lambda value: squash_to_box(jnp.array([value]), squashed)[0])(raw)
    np.testing.assert_allclose(squashing_slope(jnp.array([raw]), squashed), derivative, rtol=1e-5)


@pytest.mark.parametrize(("name", "least"), [("both", 0.2), ("lower", 0.1), ("upper", 0.1)])
def test_a_saturated_component_has_a_tenth_of_the_largest_slope(name, least):
    squashed = spec(*BOXES[name], squashed=True)
    far = jnp.array([30.0 if name == "upper" else -30.0])
    np.testing.assert_allclose(squashing_slope(far, squashed), least, rtol=1e-6)


def test_a_squashed_action_that_can_only_be_one_value_stays_it():
    fixed = in_range(spec([2.0, 0.0], [2.0, 20.0], squashed=True))

    def action(raw, shift):
        return perturb_and_project({"a": raw}, {"a": shift}, {"a": fixed})["a"]

    raw, shift = jnp.array([0.7, 0.7]), jnp.array([0.3, 0.3])
    assert action(raw, shift)[0] == 2.0
    assert action(raw, 0.0 * shift)[0] == 2.0
    for argument in (0, 1):
        slopes = jnp.diag(jax.jacobian(action, argument)(raw, shift))
        assert slopes[0] == 0.0
        assert 0.0 < slopes[1] < np.inf


def test_a_small_perturbation_of_a_squashed_action_has_the_size_that_was_asked_for():
    squashed = in_range(spec([0.0], [20.0], squashed=True))
    raw = {"a": jnp.array([0.7])}
    still, moved = (
        perturb_and_project(raw, {"a": jnp.array([shift])}, {"a": squashed})["a"]
        for shift in (0.0, 0.05)
    )
    np.testing.assert_allclose(moved - still, 0.05, rtol=1e-2)


def test_the_gradient_is_that_per_unit_of_the_squashed_action():
    squashed = in_range(spec([0.0], [20.0], squashed=True))

    def action(raw, shift):
        actions = perturb_and_project({"a": raw}, {"a": shift}, {"a": squashed})
        return actions["a"][0]

    raw, zero = jnp.array([0.7]), jnp.zeros(1)
    np.testing.assert_allclose(jax.grad(action, 1)(raw, zero), 1.0, rtol=1e-5)
    # the policy's own gradient is the squashing function's alone, noise or no noise
    slope = squashing_slope(raw + 0.1 / squashing_slope(raw, squashed), squashed)
    np.testing.assert_allclose(jax.grad(action)(raw, jnp.array([0.1])), slope, rtol=1e-5)


def sigmas(rule: AnnealedNoise, count: int) -> list[float]:
    state, found = rule.initial_state(2), []
    for _ in range(count):
        profile, state = rule.profile({"a": jnp.ones((2, 1))}, state, 2)
        found.append(float(profile.sigma[0]))
    return found


def test_annealed_noise_falls_in_cycles_of_double_length():
    rule = AnnealedNoise(sigma_max=1.0, cycle=2.0, power=1.0)
    expected = [1, 1 / 2, 1, 3 / 4, 2 / 4, 1 / 4, 1, 7 / 8]
    np.testing.assert_allclose(sigmas(rule, 8), expected, rtol=1e-5)
    bent = AnnealedNoise(sigma_max=1.0, cycle=2.0, power=3.0)
    np.testing.assert_allclose(sigmas(bent, 8), np.power(expected, 3), rtol=1e-5)


def test_another_decision_begins_with_the_first_cycle():
    rule = AnnealedNoise()
    assert float(rule.advance(jnp.asarray(17.0))) == float(rule.initial_state(2)) == 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ConstantNoise(unit="metre"), "unit must be 'absolute' or 'range', got 'metre'"),
        (lambda: AdaptiveNoise(unit=1), "unit must be 'absolute' or 'range', got 1"),
        (lambda: AnnealedNoise(cycle=0.5), "cycle must be at least 1"),
        (lambda: AnnealedNoise(power=0.0), "power must be above 0"),
        (lambda: AnnealedNoise(paired=1), "paired must be True or False"),
    ],
)
def test_values_out_of_range_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
