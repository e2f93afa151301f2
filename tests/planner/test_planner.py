"""MDPOPlanner: its analysis, what its noise reaches, and rules of a user's own."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from helpers.problems import make_plan, make_planner, optimize, shipped
from helpers.x64 import enable_x64

from mdpo_rddl.noise import ActionNoise, AdaptiveNoise, ConstantNoise, NoiseProfile, NoNoise
from mdpo_rddl.planner.config.config import load_config_from_string
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel
from mdpo_rddl.planner.start import initial_values, unit_hyperparams
from mdpo_rddl.planner.update.analysis import LossArguments


def rollout_arguments(planner, seed=0):
    subs = initial_values(planner).training
    hyperparams = unit_hyperparams(planner)
    params, _, _ = planner.initialize(jax.random.PRNGKey(seed), hyperparams, subs[0])
    params = jax.tree.map(lambda leaf: leaf[0], params)
    return params, hyperparams, *subs, planner.compiled.model_aux["params"]


@pytest.mark.parametrize(("kind", "wrap"), [("drp", True), ("slp", False)])
def test_analysis_gradient_equals_finite_differences_in_64_bit(kind, wrap):
    problem = shipped("reservoir15", horizon=6)
    plan = make_plan(kind, wrap_non_bool=wrap, initializer=jax.nn.initializers.normal(0.05))
    with enable_x64(True):
        # no straight-through estimator and a soft weight: the loss has the derivative it shows
        compiler = {"use64bit": True, "sigmoid_weight": 0.05, "print_warnings": False}
        compiler |= {"use_sigmoid_ste": False, "use_if_else_ste": False}
        noise = AdaptiveNoise(unit="absolute")
        planner = make_planner(MDPOPlanner, problem, plan, noise=noise, compiler_kwargs=compiler)
        params, hyperparams, fluents, nonfluents, model = rollout_arguments(planner)
        if kind == "slp" and not wrap:  # away from the bound, inside the box
            params = jax.tree.map(lambda leaf: leaf + 20.0, params)
        key = jax.random.PRNGKey(7)
        analyse = jax.jit(planner.compile_analysis())
        rollouts = jax.jit(planner.train_rollouts)
        given = LossArguments(params, hyperparams, fluents, nonfluents, model, None)
        gradients = analyse(key, given)

        def mean_return(perturbation):
            perturbed = PerturbedModel(model, perturbation)
            log, _ = rollouts(key, params, hyperparams, fluents, nonfluents, perturbed)
            return float(jnp.sum(log["reward"]))

        rng = np.random.default_rng(0)
        for _ in range(6):
            step, reservoir = int(rng.integers(6)), int(rng.integers(15))
            probe = np.zeros((1, 6, 15))
            probe[0, step, reservoir] = 1e-4
            up, down = mean_return({"release": probe}), mean_return({"release": -probe})
            difference = (up - down) / 2e-4
            exact = float(gradients["release"][step, reservoir])
            assert exact == pytest.approx(difference, rel=1e-4, abs=1e-6)
        assert np.all(np.any(np.asarray(gradients["release"]) != 0.0, axis=1)), "a dead step"


def test_noise_keeps_every_training_action_in_its_box():
    problem = shipped("powergen7", horizon=10)
    for kind, wrap in (("drp", False), ("drp", True), ("slp", False), ("slp", True)):
        plan = make_plan(kind, wrap_non_bool=wrap)
        planner = make_planner(MDPOPlanner, problem, plan, batch_size_train=4)
        params, hyperparams, fluents, *_ = rollout_arguments(planner)
        state = {name: value[0] for name, value in fluents.items()}
        upper = np.array([6, 6, 20, 20, 4, 4, 4], np.float32)
        seen = []
        for key in jax.random.split(jax.random.PRNGKey(1), 20):
            shift = {"curProd": 50.0 * jax.random.normal(key, (7,))}
            action = planner._perturbed_policy(key, params, hyperparams, 0, state, {}, shift)
            seen.append(np.asarray(action["curProd"]))
        seen = np.stack(seen)
        assert np.all((seen >= 0.0) & (seen <= upper))
        assert np.all(np.ptp(seen, axis=0) > 0.5 * upper), "the noise reaches no action"


@pytest.mark.long
def test_update_noise_follows_the_profile_and_leaves_the_model_s_draws_alone():
    problem = shipped("hvac10", horizon=6)
    noise = AdaptiveNoise(sigma_max=10.0, unit="absolute")
    noisy = make_planner(MDPOPlanner, problem, make_plan("drp"), noise=noise, parallel_updates=3)
    silent = make_planner(
        MDPOPlanner, problem, make_plan("drp"), noise=NoNoise(), parallel_updates=3
    )
    one = next(iter_callbacks(noisy, 2))
    other = next(iter_callbacks(silent, 2))
    assert one["sigma"].shape == one["sensitivity"].shape == (3, 6)
    assert np.all((one["sigma"] >= 0.0) & (one["sigma"] <= 10.0))
    assert len({row.tobytes() for row in np.asarray(one["sigma"])}) == 3, "restarts share a profile"
    # sigma is the map of the sensitivity that is reported beside it
    for sigma, s in zip(one["sigma"], one["sensitivity"], strict=True):
        relative = np.clip(s / (np.quantile(s, 0.95) + 1e-8), 0.0, 1.0)
        np.testing.assert_allclose(sigma, 10.0 - 10.0 * (1.0 - relative), rtol=1e-4, atol=1e-4)
    assert not np.array_equal(one["train_return"], other["train_return"])
    # who leaves when is the model's only draw; it does not depend on the actions
    for name in ("error", "termination"):
        np.testing.assert_array_equal(one["train_log"][name], other["train_log"][name])
    np.testing.assert_array_equal(
        one["train_log"]["fluents"]["occupied"], other["train_log"]["fluents"]["occupied"]
    )


def iter_callbacks(planner, epochs, **arguments):
    return planner.optimize_generator(
        key=jax.random.PRNGKey(0),
        epochs=epochs,
        print_summary=False,
        print_progress=False,
        **arguments,
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Fading(ActionNoise):
    """A user's own rule: fades with every iteration."""

    sigma: float = 4.0
    rate: float = 0.5

    def initial_state(self, horizon):
        return jnp.asarray(self.sigma)

    def profile(self, gradients, state, horizon):
        assert gradients is None
        return NoiseProfile(jnp.full(horizon, state), jnp.zeros(horizon)), self.rate * state


def test_a_user_s_own_rule_keeps_its_state_from_iteration_to_iteration():
    problem = shipped("reservoir15", horizon=5)
    planner = make_planner(
        MDPOPlanner, problem, make_plan("slp"), noise=Fading(), parallel_updates=2
    )
    sigmas = [np.asarray(callback["sigma"]) for callback in iter_callbacks(planner, 4)]
    for sigma, expected in zip(sigmas, (4.0, 2.0, 1.0, 0.5), strict=True):
        np.testing.assert_array_equal(sigma, np.full((2, 5), expected))


def test_changing_the_noise_s_numbers_recompiles_nothing(monkeypatch):
    problem = shipped("reservoir15", horizon=5)
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"), noise=ConstantNoise(1.0))
    first = optimize(planner, 3)
    traced = []
    profile = ConstantNoise.profile
    monkeypatch.setattr(ConstantNoise, "profile", lambda *a: traced.append(1) or profile(*a))
    planner.noise = ConstantNoise(2.0)
    second = optimize(planner, 3)
    assert not traced
    assert not np.array_equal(first["params"]["release"], second["params"]["release"])
    np.testing.assert_array_equal(second["sigma"], np.full((1, 5), 2.0))
    for other in (NoNoise(), ConstantNoise(0.0), AdaptiveNoise()):
        with pytest.raises(ValueError, match="cannot change"):
            planner.noise = other


def test_the_callers_policy_hyperparameters_are_left_alone():
    problem = shipped("reservoir15", horizon=5)
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"))
    given: dict = {}
    callback = optimize(planner, 2, policy_hyperparams=given)
    assert given == {}
    assert callback["policy_hyperparams"] == {"release": 1.0}


@pytest.mark.slow
def test_noise_works_with_line_search_gradient_noise_utility_and_symlog():
    problem = shipped("reservoir15", horizon=8)
    planner = make_planner(
        MDPOPlanner,
        problem,
        make_plan("slp"),
        batch_size_train=4,
        optimizer=optax.sgd,
        line_search_kwargs={"max_linesearch_steps": 5},
        noise_kwargs={"eta": 0.01, "gamma": 0.5, "key": 0},
        utility="mean_var",
        utility_kwargs={"beta": 1e-6},
        use_symlog_reward=True,
        noise=AdaptiveNoise(),
    )
    callback = optimize(planner, 4)
    assert np.all(np.isfinite(callback["train_return"]))
    assert np.any(callback["sigma"] > 0.0)


class NotingModels(MDPOPlanner):
    """Notes which model each trace of the training rollouts is given."""

    def _jax_compile_rollouts(self):
        super()._jax_compile_rollouts()
        rollouts, self.models = self.train_rollouts, []

        def noting(*arguments):
            self.models.append(type(arguments[-1]))
            return rollouts(*arguments)

        self.train_rollouts = noting


@pytest.mark.long
def test_a_line_search_compares_rollouts_with_the_same_noise():
    problem = shipped("reservoir15", horizon=2)
    search = {"optimizer": optax.sgd, "line_search_kwargs": {"max_linesearch_steps": 2}}
    planner = make_planner(
        NotingModels, problem, make_plan("slp"), noise=ConstantNoise(0.1), **search
    )
    optimize(planner, 1)
    assert len(planner.models) > 1
    assert set(planner.models) == {PerturbedModel}


def test_a_rule_that_is_given_wins_over_a_configurations():
    problem = shipped("reservoir15", horizon=2)
    text = "[Compiler]\n[Planner]\nmethod='JaxStraightLinePlan'\n[Optimize]\n"
    text += "[Noise]\nmethod='AdaptiveNoise'\n"
    planner_args, _, _ = load_config_from_string(text)
    planner_args |= {"pgpe": None, "batch_size_train": 1, "batch_size_test": 1}
    assert MDPOPlanner(problem.model, **planner_args).noise == AdaptiveNoise(
        sigma_max=10.0, unit="absolute"
    )
    planner_args["plan"] = make_plan("slp")
    planner = MDPOPlanner(problem.model, **planner_args, noise=NoNoise())
    assert planner.noise == NoNoise()


def test_noise_must_be_a_rule():
    problem = shipped("reservoir15", horizon=5)
    with pytest.raises(TypeError, match="must be an ActionNoise, got float"):
        MDPOPlanner(problem.model, make_plan("slp"), noise=1.0)
