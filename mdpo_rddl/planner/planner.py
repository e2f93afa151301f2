"""MDPO as a subclass of JaxPlan's planner."""

import functools
import inspect
from collections.abc import Callable, Generator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.noise import ActionNoise, default_noise
from mdpo_rddl.noise.actions import ActionSpec
from mdpo_rddl.noise.projection import perturb_and_project
from mdpo_rddl.planner.calling import CallingPlanner
from mdpo_rddl.planner.plans.feedback_actions import FeedbackActions
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.plans.legal import LegalActions, legal_policy
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel, RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import stop_at_termination
from mdpo_rddl.planner.update.action_scales import specs_in_unit
from mdpo_rddl.planner.update.analysis import (
    LossArguments,
    NoiseShape,
    compile_analysis,
    mean_loss,
)
from mdpo_rddl.planner.update.finite import without_lost_updates
from mdpo_rddl.planner.update.noisy_update import noisy_update, sensed_gradients
from mdpo_rddl.planner.update.pairs import finite_test_loss, folded, half_the_lanes, side_by_side
from mdpo_rddl.planner.update.perturbed_policy import (
    action_specs,
    compile_raw_policy,
    copy_uncompiled,
    limited_policies,
    perturbed_policy,
)
from mdpo_rddl.planner.update.plain_rule import PlainUpdatesRule
from mdpo_rddl.planner.update.restarts import PerRestart, Restarts, require_one_each
from mdpo_rddl.planner.update.sharding import shard
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.problem.limits import GroupLimit, group_limits


class MDPOPlanner(CallingPlanner):
    """JaxPlan's planner with noise on the actions during optimisation.

    Each iteration makes up to two passes over the relaxed model, for every parallel update:

    1. an analysis rollout without action noise, whose return is differentiated with respect
       to the raw action at every step (later actions answer through the policy);
    2. an update rollout, whose raw actions carry noise of the profile that `noise` makes of
       that gradient, and from which JaxPlan's own update takes the parameters' gradient.

    The loop, the optimiser, the callbacks and the stopping rules are JaxPlan's. With
    `NoNoise` the parameters equal JaxPlan's bit for bit for the same key.
    """

    perturb = staticmethod(perturb_and_project)  # a subclass may perturb elsewhere

    def __init__(
        self,
        *args: Any,
        noise: ActionNoise | None = None,
        configured_noise: ActionNoise | None = None,
        stop_at_termination: bool = False,
        keep_group_limits: bool = True,
        **kwargs: Any,
    ) -> None:
        """Takes every argument of `JaxBackpropPlanner` and of `CallingPlanner`, and:

        Args:
          noise: the rule for the action noise.
          configured_noise: the rule where `noise` is None, as `load_config` gives it;
            `default_noise()` if that is None too.
          stop_at_termination: whether rewards after a termination condition do not count, as
            in the exact environment; JaxPlan counts them. Invariants alone end nothing here.
          keep_group_limits: whether preconditions of the form "at most k of these bools" hold
            in training and in play, and the others in play; JaxPlan ignores them.

        Raises:
          TypeError: if `noise` is not an `ActionNoise`.
        """
        if noise is None:
            noise = default_noise() if configured_noise is None else configured_noise
        if not isinstance(noise, ActionNoise):
            raise TypeError(f"noise must be an ActionNoise, got {type(noise).__name__}")
        self._restarts = Restarts(noise)
        self._noise_state: Any = None
        self._guess: Any = None
        self._noise_state_at_guess: Any = None
        self.stop_at_termination = stop_at_termination
        self.keep_group_limits = keep_group_limits
        self.action_specs: dict[str, ActionSpec] = {}
        # by the number of rollouts; kept with the planner, whose compilation they belong to
        self.exact_programs: dict[int, Callable[..., Any]] = {}
        super().__init__(*args, **kwargs)

    @property
    def noise(self) -> ActionNoise:
        """The rule for the action noise.

        A rule of the same kind with other numbers takes effect at the next `optimize`; one that
        the planner was not compiled for raises ValueError.
        """
        return self._restarts.noise

    @noise.setter
    def noise(self, noise: ActionNoise) -> None:
        self._restarts.noise = noise

    def vary_restarts(
        self, noise: Sequence[ActionNoise] | None = None, **hyperparams: Sequence[float]
    ) -> None:
        """Gives each parallel update its own noise rule and optimiser's hyperparameters.

        They hold from the next `optimize` on. Called without arguments, all are the same again.

        Args:
          noise: one rule for each, of the kind that the planner was compiled for.
          **hyperparams: one value for each, by the name that optax injects it under, such as
            `learning_rate`.

        Raises:
          ValueError: if there are not as many as `restarts`, or a rule is of another kind.
        """
        require_one_each(self.restarts, noise, hyperparams)
        lay_out = functools.partial(shard, sharding=self._sharding)
        if self.is_paired:  # the update without noise has its companion's values
            noise = None if noise is None else [*noise, *noise]
            hyperparams = {name: [*values, *values] for name, values in hyperparams.items()}
        self._restarts.vary(noise, hyperparams, lay_out)

    @property
    def is_paired(self) -> bool:
        """Whether each update has a companion: the rule is paired, and not silent."""
        return self.noise.paired and not self.noise.silent

    @property
    def restarts(self) -> int:
        """How many policies are trained side by side, without their companions.

        `parallel_updates` counts those too: one with noise beside each, where the rule is paired.
        """
        return self.parallel_updates // (2 if self.is_paired else 1)

    @property
    def _watched(self) -> int | None:
        return self.restarts if self.is_paired else None

    @functools.wraps(JaxBackpropPlanner.as_optimization_problem)
    def as_optimization_problem(self, *args: Any, **kwargs: Any) -> Any:
        """JaxPlan's, without noise: a companion is no part of it."""
        with half_the_lanes(self, self.is_paired):
            return super().as_optimization_problem(*args, **kwargs)

    # JaxPlan's compilation hooks, in the order in which it calls them

    def _jax_compile_graph(self) -> None:
        self.parallel_updates *= 2 if self.is_paired else 1
        super()._jax_compile_graph()

    def _jax_compile_policy(self) -> None:
        if isinstance(self.plan, GreedyPlan):
            self.plan.exact = self.test_compiled
        raw = copy_uncompiled(self.plan)
        super()._jax_compile_policy()
        legal = self.keep_group_limits and not open_plan(self.plan).is_legal
        limits = group_limits(self.rddl)[0] if legal else []
        if limits:
            self.plan.train_policy, self.plan.test_policy = limited_policies(self.plan, limits)
            self.train_policy = jax.jit(self.plan.train_policy)
        plain, exact = self.plan.test_policy, self.test_compiled
        self.legal_policy = legal_policy(self.plan, exact, limits) if legal else plain
        self.test_policy = self.acting_jit(self.legal_policy)
        bounded = action_specs(self.plan, self.compiled, self._action_bounds)
        self.action_specs = specs_in_unit(self, bounded)
        self.raw_policy = compile_raw_policy(raw, self.compiled, self.horizon, self.preprocessor)
        self._perturbed_policy = perturbed_policy(
            self.raw_policy, self.plan, self.rddl, self.action_specs, limits, self.perturb
        )

    @functools.cached_property
    def numpy_actions(self) -> tuple[FeedbackActions, list[GroupLimit]] | None:
        """A feedback policy's formula on numpy, and the limits on groups of bools that it keeps.

        None where actions are made legal by more than boxes and such limits, or of another plan.
        """
        if not isinstance(self.plan, FeedbackPlan):
            return None
        limits = group_limits(self.rddl)[0] if self.keep_group_limits else []
        if self.keep_group_limits:
            legal = LegalActions(self.test_compiled, [*limits, *self.plan.concurrency])
            if not legal.has_boxes_only:
                return None
        return self.plan.actions.on_numpy(), limits

    @property
    def is_noisy(self) -> bool:
        """Whether anything is perturbed at all; if not, the planner is JaxPlan's."""
        return bool(self.action_specs) and not self.noise.silent

    def _jax_compile_rollouts(self) -> None:
        super()._jax_compile_rollouts()
        stopping = self.stop_at_termination and bool(self.rddl.terminations)
        watched, memory = self.dashboard is not None, open_plan(self.plan).memory
        training = (self.compiled, self.batch_size_train, self.preprocessor is not None or watched)
        testing = (self.test_compiled, self.batch_size_test, watched)

        def compiled_rollouts(policy, model, batch_size, cache_path_info, differentiated=True):
            options = RolloutOptions(
                copies=self.parallel_updates,
                history_dependent=self.plan.history_dependent,
                check_constraints=stopping,
                cache_path_info=cache_path_info,
                differentiated=differentiated,
                memory=memory,
            )
            rollouts = compile_rollouts(model, policy, self.horizon, batch_size, options)
            return stop_at_termination(rollouts) if stopping else rollouts

        # else JaxPlan's rollouts, bit for bit
        if stopping or self.in_calls or memory.initial:
            self.train_rollouts = compiled_rollouts(self.plan.train_policy, *training)
            tested = compiled_rollouts(self.plan.test_policy, *testing, differentiated=False)
            self.test_rollouts = jax.jit(tested)
        if not self.is_noisy:
            return
        perturbed_rollouts = compiled_rollouts(self._perturbed_policy, *training)
        plain_rollouts = self.train_rollouts

        def rollouts(key, params, hyperparams, fluents, nonfluents, model):
            given = key, params, hyperparams, fluents, nonfluents, model
            if not isinstance(model, PerturbedModel):
                return plain_rollouts(*given)
            log, after = perturbed_rollouts(*given)
            # JaxPlan's line search tries its steps in the model that the rollouts have left
            return log, PerturbedModel(after, model.perturbation)

        self.train_rollouts = rollouts

    def _jax_init_optimizer(self) -> tuple[Callable, Callable]:
        initialize, init_optimizer = super()._jax_init_optimizer()

        def initialize_all(key, policy_hyperparams, fluents):
            params, opt_state, opt_aux = initialize(key, policy_hyperparams, fluents)
            if self.is_noisy:
                state = self._broadcast_pytree(self.noise.initial_state(self.horizon))
                opt_aux = self._with_noise(opt_aux, params, state)
            return params, self._restarts.with_hyperparams(opt_state), opt_aux

        def init_optimizer_warm(policy_params):
            # JaxPlan calls this for a warm start: the noise's state moves with the plan
            opt_state, opt_aux = init_optimizer(policy_params)
            if self.is_noisy:
                state = self._noise_state_at_guess
                if state is None:
                    state = self._broadcast_pytree(self.noise.initial_state(self.horizon))
                else:
                    noise = self._restarts.rules(self._broadcast_pytree)
                    state = jax.vmap(lambda rule, state: rule.advance(state))(noise, state)
                opt_aux = self._with_noise(opt_aux, policy_params, state)
            return self._restarts.with_hyperparams(opt_state), opt_aux

        return initialize_all, init_optimizer_warm

    def _with_noise(self, opt_aux: dict[str, Any], params: Any, state: Any) -> dict[str, Any]:
        """What the noisy update carries on, beside what JaxPlan's does."""
        opt_aux = {**opt_aux, "noise": (self._restarts.rules(self._broadcast_pytree), state)}
        sensed = sensed_gradients(self.plan, self.noise, self.action_specs)
        if sensed is None:
            return opt_aux
        return {**opt_aux, "sensed": jax.tree.map(jnp.zeros_like, sensed(params))}

    def _jax_compile_test_loss(self) -> None:
        super()._jax_compile_test_loss()
        if self.is_noisy:
            self.update = self._remembering(self.update)

    def _remembering(self, update: Callable) -> Callable:
        def update_and_remember(*arguments):
            result = update(*arguments)
            self._noise_state = result[3]["noise"][1]
            return result

        return update_and_remember

    def _jax_update(self, loss: Callable) -> Callable:
        is_paired = self.is_noisy and self.is_paired
        with half_the_lanes(self, is_paired):
            plain_update = super()._jax_update(loss)
            if not self.is_noisy:
                # one iteration at a time it is JaxPlan's, bit for bit
                return without_lost_updates(plain_update) if self.in_calls else plain_update
            update = noisy_update(
                plain_update,
                self.compile_analysis() if self.noise.analysis_samples else None,
                sensed_gradients(self.plan, self.noise, self.action_specs),
                self._noise_shape(),
                self.parallel_updates,
            )
        update = jax.jit(without_lost_updates(update))
        return side_by_side(plain_update, update, self.horizon) if is_paired else update

    def _broadcast_pytree(self, pytree: Any) -> Any:
        if type(pytree) is PerRestart and self.is_paired:
            pytree = PerRestart(
                jax.tree.map(lambda leaf: jnp.concatenate([leaf, leaf]), pytree.params)
            )
        return super()._broadcast_pytree(pytree)

    def _comparable(self, test_loss: Callable) -> Callable:
        return finite_test_loss(test_loss) if self.is_paired else test_loss

    def compile_analysis(self) -> Callable[[Array, LossArguments], dict[str, Array]]:
        """The pass that differentiates the return by the actions, as an iteration makes it."""
        return compile_analysis(mean_loss(self), self._noise_shape(), self.noise.analysis_samples)

    def _noise_shape(self) -> NoiseShape:
        dtype = self.compiled.REAL
        return NoiseShape(self.action_specs, self.horizon, self.batch_size_train, dtype)

    def summarize_hyperparameters(self) -> str:
        """JaxPlan's summary, and the noise's."""
        return super().summarize_hyperparameters() + (
            "[INFO] action noise hyper-parameters:\n"
            f"    noise              ={self.noise}\n"
            f"    perturbed actions  ={', '.join(self.action_specs) or 'none'}\n"
            f"    stop_at_termination={self.stop_at_termination}\n"
            f"    keep_group_limits  ={self.keep_group_limits}\n"
        )

    @functools.wraps(JaxBackpropPlanner.optimize_generator, assigned=())
    def optimize_generator(
        self, *args: Any, **kwargs: Any
    ) -> Generator[dict[str, Any], None, None]:
        """JaxPlan's generator; each callback also holds the noise's own figures.

        `sigma` [restarts, H] is the scale of the noise per step and `sensitivity`, of
        the same shape, the return's sensitivity behind it (zeros without an analysis). Paired
        noise shows the better one of each pair; a stopping rule watches JaxPlan's own updates.
        """
        signature = inspect.signature(JaxBackpropPlanner.optimize_generator)
        given = signature.bind(self, *args, **kwargs)
        names = ("policy_hyperparams", "guess", "stopping_rule")
        hyperparams, guess, rule = (given.arguments.get(name) for name in names)
        if isinstance(hyperparams, dict):
            given.arguments["policy_hyperparams"] = dict(hyperparams)
        if guess is not self._guess:
            # JaxPlan's online controller tries the same guess again if compiling took all its time
            self._guess, self._noise_state_at_guess = guess, self._noise_state
        if rule is not None and self.is_paired:
            best = self._calls.watched_entries if self.in_calls else None
            given.arguments["stopping_rule"] = PlainUpdatesRule(rule, best)
        yield from super().optimize_generator(*given.args[1:], **given.kwargs)

    def _complete(self, callback: dict[str, Any]) -> None:
        super()._complete(callback)
        log, shape = callback["train_log"], (self.parallel_updates, self.horizon)
        for name in ("sigma", "sensitivity"):
            callback[name] = log[name] if name in log else np.zeros(shape, self.compiled.REAL)

    def _finish(self, callback: dict[str, Any]) -> None:
        super()._finish(callback)
        if self.is_paired:
            callback.update(folded(callback))
