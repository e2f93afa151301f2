"""MDPO as a subclass of JaxPlan's planner."""

import functools
import inspect
from collections.abc import Callable, Generator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.actions import ActionSpec
from mdpo_rddl.jaxplan.analysis import compile_analysis
from mdpo_rddl.jaxplan.perturbed_policy import (
    action_specs,
    compile_raw_policy,
    copy_uncompiled,
    limited_policies,
    perturbed_policy,
)
from mdpo_rddl.jaxplan.rollout import PerturbedModel, compile_perturbed_rollouts
from mdpo_rddl.jaxplan.termination import stop_at_termination
from mdpo_rddl.jaxplan.upstream import GaussianPGPE, JaxBackpropPlanner, JaxPlannerStatus
from mdpo_rddl.limits import group_limits
from mdpo_rddl.noise import ActionNoise, AdaptiveNoise
from mdpo_rddl.noise.draws import draw_perturbation

# folded into JaxPlan's key of an iteration, so that the model draws what it draws in JaxPlan
_ANALYSIS_STREAM = 0x616E61
_UPDATE_STREAM = 0x757064


class MDPOPlanner(JaxBackpropPlanner):
    """JaxPlan's planner with noise on the actions during optimisation.

    Each iteration makes up to two passes over the relaxed model, for every parallel update:

    1. an analysis rollout without action noise, whose return is differentiated with respect
       to the raw action at every step (later actions answer through the policy);
    2. an update rollout, whose raw actions carry noise of the profile that `noise` makes of
       that gradient, and from which JaxPlan's own update takes the parameters' gradient.

    The loop, the optimiser, the callbacks and the stopping rules are JaxPlan's. With
    `NoNoise` the parameters equal JaxPlan's bit for bit for the same key.
    """

    def __init__(
        self,
        *args: Any,
        noise: ActionNoise | None = None,
        stop_at_termination: bool = False,
        keep_group_limits: bool = True,
        **kwargs: Any,
    ) -> None:
        """Takes every argument of `JaxBackpropPlanner`, and:

        Args:
          noise: the rule for the action noise; `AdaptiveNoise()` if None.
          stop_at_termination: whether rewards after a termination condition count for
            nothing, as in the exact environment; JaxPlan counts them.
          keep_group_limits: whether preconditions of the form "at most k of these bools" hold
            in training and in play (`mdpo_rddl.limits`); JaxPlan ignores them.

        Raises:
          TypeError: if `noise` is not an `ActionNoise`.
        """
        if noise is None:
            noise = AdaptiveNoise()
        if not isinstance(noise, ActionNoise):
            raise TypeError(f"noise must be an ActionNoise, got {type(noise).__name__}")
        self._noise = noise
        self._noise_state: Any = None
        self._guess: Any = None
        self._noise_state_at_guess: Any = None
        self.stop_at_termination = stop_at_termination
        self.keep_group_limits = keep_group_limits
        self.action_specs: dict[str, ActionSpec] = {}
        given = inspect.signature(JaxBackpropPlanner.__init__).bind_partial(None, *args, **kwargs)
        if "pgpe" not in given.arguments:
            # JaxPlan's default is one object shared by all planners, which the second breaks
            kwargs["pgpe"] = GaussianPGPE()
        super().__init__(*args, **kwargs)

    @property
    def noise(self) -> ActionNoise:
        """The rule for the action noise.

        A rule of the same kind with other numbers can be assigned, and takes effect at the
        next `optimize` without a recompilation.

        Raises:
          ValueError: on assignment of a rule that the planner was not compiled for.
        """
        return self._noise

    @noise.setter
    def noise(self, noise: ActionNoise) -> None:
        kinds = [str(jax.tree.structure(rule)) for rule in (noise, self._noise)]
        if kinds[0] != kinds[1] or noise.silent != self._noise.silent:
            raise ValueError(f"compiled for {self._noise}, cannot change to {noise}")
        self._noise = noise

    # JaxPlan's compilation hooks, in the order in which it calls them

    def _jax_compile_policy(self) -> None:
        raw_plan = copy_uncompiled(self.plan)
        super()._jax_compile_policy()
        limits = group_limits(self.rddl)[0] if self.keep_group_limits else []
        if limits:
            self.plan.train_policy, self.plan.test_policy = limited_policies(self.plan, limits)
            self.train_policy = jax.jit(self.plan.train_policy)
            self.test_policy = jax.jit(self.plan.test_policy)
        self.action_specs = action_specs(self.plan, self.compiled)
        raw_policy = compile_raw_policy(raw_plan, self.compiled, self.horizon, self.preprocessor)
        self._perturbed_policy = perturbed_policy(
            raw_policy, self.plan, self.rddl, self.action_specs, limits
        )

    @property
    def is_noisy(self) -> bool:
        """Whether anything is perturbed at all; if not, the planner is JaxPlan's."""
        return bool(self.action_specs) and not self.noise.silent

    def _jax_compile_rollouts(self) -> None:
        super()._jax_compile_rollouts()
        stopping = self.stop_at_termination and bool(self.rddl.terminations)
        if stopping:
            self._jax_compile_stopping_rollouts()
        if not self.is_noisy:
            return
        perturbed_rollouts = compile_perturbed_rollouts(
            self.compiled,
            self._perturbed_policy,
            self.horizon,
            history_dependent=self.plan.history_dependent,
            check_constraints=stopping,
            cache_path_info=self.preprocessor is not None or self.dashboard is not None,
        )
        if stopping:
            perturbed_rollouts = stop_at_termination(perturbed_rollouts)
        plain_rollouts = self.train_rollouts

        def rollouts(key, params, hyperparams, fluents, nonfluents, model):
            chosen = perturbed_rollouts if isinstance(model, PerturbedModel) else plain_rollouts
            return chosen(key, params, hyperparams, fluents, nonfluents, model)

        self.train_rollouts = rollouts

    def _jax_compile_stopping_rollouts(self) -> None:
        """JaxPlan's rollouts once more, with the ends of episodes noted and heeded."""
        watched = self.dashboard is not None
        shared = {
            "n_steps": self.horizon,
            "history_dependent": self.plan.history_dependent,
            "check_constraints": True,
        }
        train_rollouts = self.compiled.compile_rollouts(
            policy=self.plan.train_policy,
            n_batch=self.batch_size_train,
            cache_path_info=self.preprocessor is not None or watched,
            **shared,
        )
        test_rollouts = self.test_compiled.compile_rollouts(
            policy=self.plan.test_policy,
            n_batch=self.batch_size_test,
            cache_path_info=watched,
            **shared,
        )
        self.train_rollouts = stop_at_termination(train_rollouts)
        self.test_rollouts = jax.jit(stop_at_termination(test_rollouts))

    def _jax_init_optimizer(self) -> tuple[Callable, Callable]:
        initialize, init_optimizer = super()._jax_init_optimizer()
        if not self.is_noisy:
            return initialize, init_optimizer

        def initialize_with_noise(key, policy_hyperparams, fluents):
            params, opt_state, opt_aux = initialize(key, policy_hyperparams, fluents)
            noise_and_state = (self.noise, self.noise.initial_state(self.horizon))
            return params, opt_state, {**opt_aux, "noise": self._broadcast_pytree(noise_and_state)}

        def init_optimizer_with_noise(policy_params):
            # JaxPlan calls this for a warm start: the noise's state moves with the plan
            opt_state, opt_aux = init_optimizer(policy_params)
            noise = self._broadcast_pytree(self.noise)
            state = self._noise_state_at_guess
            if state is None:
                state = self._broadcast_pytree(self.noise.initial_state(self.horizon))
            else:
                state = jax.vmap(lambda rule, state: rule.advance(state))(noise, state)
            return opt_state, {**opt_aux, "noise": (noise, state)}

        return initialize_with_noise, init_optimizer_with_noise

    def _jax_update(self, loss: Callable) -> Callable:
        plain_update = super()._jax_update(loss)
        if not self.is_noisy:
            return plain_update
        analyse = self._jax_analysis()
        dtype = self.compiled.REAL

        def draw(key, params, hyperparams, fluents, nonfluents, model, critic, noise_and_state):
            noise, state = noise_and_state
            gradients = None
            if noise.analysis_samples:
                analysis_key = random.fold_in(key, _ANALYSIS_STREAM)
                gradients = analyse(
                    analysis_key, params, hyperparams, fluents, nonfluents, model, critic
                )
            profile, state = noise.profile(gradients, state, self.horizon)
            update_key = random.fold_in(key, _UPDATE_STREAM)
            perturbation = draw_perturbation(
                update_key, profile.sigma, self.action_specs, self.batch_size_train, dtype
            )
            return perturbation, profile, (noise, state)

        batched_draw = jax.vmap(draw, in_axes=(0, 0, None, None, None, 0, None, 0))

        def update(
            key, params, hyperparams, fluents, nonfluents, model, critic, opt_state, opt_aux
        ):
            perturbation, profile, noise_and_state = batched_draw(
                random.split(key, self.parallel_updates),
                params,
                hyperparams,
                fluents,
                nonfluents,
                model,
                critic,
                opt_aux["noise"],
            )
            opt_aux = {**opt_aux, "noise": noise_and_state}
            model = PerturbedModel(model, perturbation)
            result = plain_update(
                key, params, hyperparams, fluents, nonfluents, model, critic, opt_state, opt_aux
            )
            log = {**result[5], "sigma": profile.sigma, "sensitivity": profile.sensitivity}
            return (*result[:5], log, *result[6:])

        compiled_update = jax.jit(update)

        def update_and_remember(*arguments):
            result = compiled_update(*arguments)
            self._noise_state = result[3]["noise"][1]
            return result

        return update_and_remember

    def _jax_analysis(self) -> Callable:
        return compile_analysis(
            self._jax_mean_loss(),
            self.action_specs,
            self.horizon,
            self.noise.analysis_samples,
            self.compiled.REAL,
        )

    def _jax_mean_loss(self) -> Callable:
        """JaxPlan's training loss with the mean as its utility, as the sensitivity is defined."""
        utility, utility_kwargs = self.utility, self.utility_kwargs
        self.utility, self.utility_kwargs = jnp.mean, {}
        try:
            return self._jax_loss(self.train_rollouts)
        finally:
            self.utility, self.utility_kwargs = utility, utility_kwargs

    def get_action(
        self,
        key: Array,
        params: Any,
        step: int,
        state: Mapping[str, Any],
        policy_hyperparams: Any = None,
        history: Any = None,
    ) -> dict[str, Any]:
        """JaxPlan's action, with reals clipped to the RDDL's box in 64 bit.

        A bound rounded to 32 bit can lie outside the box, which an environment with
        `enforce_action_constraints=True` refuses. Policy hyperparameters that are not given
        are 1, as in `optimize`.
        """
        hyperparams = self._complete_hyperparams(policy_hyperparams)
        actions = dict(super().get_action(key, params, step, state, hyperparams, history))
        for name, prange in self.rddl.action_ranges.items():
            if prange == "real" and name in actions:
                bounds = self.test_compiled.constraints.bounds[name]
                actions[name] = np.clip(np.asarray(actions[name], np.float64), *bounds)
        return actions

    def _complete_hyperparams(self, hyperparams: Any) -> Any:
        if hyperparams is not None and not isinstance(hyperparams, Mapping):
            return hyperparams
        complete = {**dict.fromkeys(self.rddl.action_fluents, 1.0), **(hyperparams or {})}
        if self.preprocessor is not None and self.preprocessor.HYPERPARAMS_KEY not in complete:
            complete[self.preprocessor.HYPERPARAMS_KEY] = self.preprocessor.initialize()
        return complete

    def summarize_hyperparameters(self) -> str:
        """JaxPlan's summary, and the noise's."""
        return super().summarize_hyperparameters() + (
            "[INFO] action noise hyper-parameters:\n"
            f"    noise              ={self.noise}\n"
            f"    perturbed actions  ={', '.join(self.action_specs) or 'none'}\n"
            f"    stop_at_termination={self.stop_at_termination}\n"
            f"    keep_group_limits  ={self.keep_group_limits}\n"
        )

    def params_structure(self, policy_hyperparams: Mapping[str, Any]) -> Any:
        """Shapes and types of one policy's parameters, as a tree of `jax.ShapeDtypeStruct`."""
        (fluents, _), _ = self._batched_init_subs(self.test_compiled.init_values)
        key = random.PRNGKey(0)
        return jax.eval_shape(self.plan.initializer, key, dict(policy_hyperparams), fluents)

    @functools.wraps(JaxBackpropPlanner.optimize_generator, assigned=())
    def optimize_generator(
        self, *args: Any, **kwargs: Any
    ) -> Generator[dict[str, Any], None, None]:
        """JaxPlan's generator; each callback also holds the noise's own figures.

        `sigma` [parallel updates, H] is the scale of the noise per step and `sensitivity`
        [parallel updates, H] the return's sensitivity behind it (zeros where no analysis
        was made). The `policy_hyperparams` that the caller passes are left as they are.
        """
        signature = inspect.signature(JaxBackpropPlanner.optimize_generator)
        given = signature.bind(self, *args, **kwargs)
        hyperparams = given.arguments.get("policy_hyperparams")
        if isinstance(hyperparams, dict):
            given.arguments["policy_hyperparams"] = dict(hyperparams)
        guess = given.arguments.get("guess")
        if guess is not self._guess:
            # JaxPlan's online controller tries the same guess again if compiling took all its time
            self._guess, self._noise_state_at_guess = guess, self._noise_state
        once = given.arguments.get("epochs") == 1
        if once:  # JaxPlan divides by epochs - 1
            given.arguments["epochs"] = 2
        silence = jnp.zeros((self.parallel_updates, self.horizon))
        for callback in super().optimize_generator(*given.args[1:], **given.kwargs):
            log = callback["train_log"]
            callback["sigma"] = log.get("sigma", silence)
            callback["sensitivity"] = log.get("sensitivity", silence)
            if once and not callback["status"].is_terminal():
                budget = JaxPlannerStatus.ITER_BUDGET_REACHED
                callback.update(status=budget, progress=100.0)
            yield callback
            if once:
                return
