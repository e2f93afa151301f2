"""A planner one turn of whose loop can be a compiled call of several iterations."""

import contextlib
import functools
import inspect
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import Any

import jax.numpy as jnp
from jax import Array

from mdpo_rddl.planner.acting import ActingPlanner
from mdpo_rddl.planner.update.callback_rule import CallbackRule
from mdpo_rddl.planner.update.calls import Calls
from mdpo_rddl.planner.update.finite import FiniteBest
from mdpo_rddl.planner.update.restarts import PerRestart
from mdpo_rddl.planner.update.sharding import restart_sharding, shard
from mdpo_rddl.planner.update.sizes import CallSizes
from mdpo_rddl.planner.upstream import GaussianPGPE, JaxBackpropPlanner, JaxPlannerStatus
from mdpo_rddl.problem.boxes import boxes


class CallingPlanner(ActingPlanner):
    """JaxPlan's planner with several iterations a turn, its restarts spread over the devices.

    Attributes:
      lose_on_error: whether a rollout of the exact model is lost where the environment would raise
        an error; set before it is compiled.
    """

    lose_on_error = False

    def __init__(
        self,
        *args: Any,
        iterations_per_call: int = 1,
        test_every: int | None = None,
        **kwargs: Any,
    ) -> None:
        """Takes every argument of `JaxBackpropPlanner`, and:

        Args:
          iterations_per_call: iterations of one turn of the loop; more than 1 are compiled
            into one call.
          test_every: iterations from one test to the next; one test a call if None.

        Raises:
          ValueError: if `test_every` does not divide `iterations_per_call`.
        """
        every = iterations_per_call if test_every is None else test_every
        self._sizes = CallSizes(iterations_per_call, every)
        self.in_calls = iterations_per_call > 1
        self._calls = Calls()
        self._first_params: Any = None
        given = inspect.signature(JaxBackpropPlanner.__init__).bind_partial(None, *args, **kwargs)
        if "pgpe" not in given.arguments:
            # JaxPlan's default is one object shared by all planners, which the second breaks
            kwargs["pgpe"] = GaussianPGPE()
        super().__init__(*args, **kwargs)

    @property
    def iterations_per_call(self) -> int:
        """Iterations of one turn of the loop."""
        return self._sizes.iterations

    @property
    def test_every(self) -> int:
        """Iterations from one test to the next."""
        return self._sizes.test_every

    @contextlib.contextmanager
    def call_sizes(
        self, iterations: int | None = None, test_every: int | None = None
    ) -> Iterator[None]:
        """Calls of other sizes, without a recompilation; the end of the block undoes it.

        Args:
          iterations: of one call; as many as before if None.
          test_every: iterations from one test to the next; as before if None.

        Raises:
          ValueError: if `test_every` does not divide `iterations`.
        """
        before = self._sizes
        iterations = before.iterations if iterations is None else iterations
        self._sizes = CallSizes(iterations, before.test_every if test_every is None else test_every)
        try:
            yield
        finally:
            self._sizes = before

    def set_call_sizes(self, iterations: int, test_every: int) -> None:
        """Calls of other sizes from now on.

        Raises:
          ValueError: if `test_every` does not divide `iterations`.
        """
        self._sizes = CallSizes(iterations, test_every)

    def bound_calls(self, iterations: float) -> None:
        """Makes calls shorter, so that a bound on the time can be kept.

        Args:
          iterations: the most that a call may have, if that is at least 1.
        """
        self._sizes = self._sizes.bounded(iterations)

    def compile_calls_with(self, jit: Callable[[Callable], Callable]) -> None:
        """Has calls of several iterations compiled by something that stands in for `jax.jit`."""
        if self.in_calls:
            self._calls.compile_with(jit)

    # JaxPlan's compilation hooks

    def _jax_compile_rddl(self) -> None:
        super()._jax_compile_rddl()
        for compiled in (self.compiled, self.test_compiled):
            compiled.constraints.bounds = boxes(compiled.constraints.sim)

    def _jax_compile_graph(self) -> None:
        if self.in_calls and (self.use_pgpe or self.preprocessor is not None):
            raise ValueError("several iterations a call need pgpe=None and no preprocessor")
        self._sharding = restart_sharding(self.parallel_updates)
        super()._jax_compile_graph()

    def _jax_compile_pgpe(self) -> None:
        super()._jax_compile_pgpe()
        if self.use_pgpe:
            self.pgpe._update = _with_equal_types(self.pgpe.update)

    def _jax_merge_pgpe_jaxplan(self) -> Callable:
        return _with_one_flag_each(super()._jax_merge_pgpe_jaxplan())

    def _jax_init_optimizer(self) -> tuple[Callable, Callable]:
        initialize, init_optimizer = super()._jax_init_optimizer()

        def initialize_all(key, policy_hyperparams, fluents):
            initialized = initialize(key, policy_hyperparams, fluents)
            params, opt_state, opt_aux = shard(initialized, self._sharding)
            return params, opt_state, self._with_call(opt_aux, params, is_warm=False)

        def init_optimizer_warm(policy_params):
            # JaxPlan calls this for a warm start
            opt_state, opt_aux = init_optimizer(policy_params)
            return opt_state, self._with_call(opt_aux, policy_params, is_warm=True)

        return initialize_all, init_optimizer_warm

    def _with_call(self, opt_aux: dict[str, Any], params: Any, is_warm: bool) -> dict[str, Any]:
        self._first_params = params
        if not self.in_calls:
            return opt_aux
        test_model = self._broadcast_pytree(self.test_compiled.model_aux["params"])
        state = self._calls.first_state(params, test_model, is_warm, self._watched)
        return {**opt_aux, "call": state}

    @property
    def _watched(self) -> int | None:
        """How many parallel updates, the first ones, a stopping rule is shown; None for all."""
        return None

    def _batched_init_subs(self, init_values: Mapping[str, Any]) -> Any:
        subs = super()._batched_init_subs(init_values)
        self._calls.test_fluents = subs[1]
        return subs

    def _broadcast_pytree(self, pytree: Any) -> Any:
        if isinstance(pytree, PerRestart):
            return shard(pytree.params, self._sharding)
        return shard(super()._broadcast_pytree(pytree), self._sharding)

    def _jax_compile_test_loss(self) -> None:
        super()._jax_compile_test_loss()
        self.test_loss: Callable = self._comparable(self.test_loss)
        if self.in_calls:
            self._calls.compile(self.update, self.test_loss, self._sharding)
            self.update: Callable = functools.partial(self._calls.update, lambda: self._sizes)
            self.test_loss = self._calls.test_loss

    def _comparable(self, test_loss: Callable) -> Callable:
        """The test loss [parallel updates] by which JaxPlan's loop compares the updates."""
        return test_loss

    def _complete(self, callback: dict[str, Any]) -> None:
        """Adds to JaxPlan's callback what its stopping rule should see."""
        if self.in_calls:
            callback.update(self._calls.callback_entries())

    def _finish(self, callback: dict[str, Any]) -> None:
        """Changes what is shown of a callback, after the stopping rule has seen it."""

    @functools.wraps(JaxBackpropPlanner.optimize_generator, assigned=())
    def optimize_generator(
        self, *args: Any, **kwargs: Any
    ) -> Generator[dict[str, Any], None, None]:
        """JaxPlan's generator; a turn of its loop is a call."""
        signature = inspect.signature(JaxBackpropPlanner.optimize_generator)
        given = signature.bind(self, *args, **kwargs)
        given.apply_defaults()
        epochs = given.arguments["epochs"]
        if self.in_calls:
            self._calls.begin(given.arguments)
            epochs = given.arguments["epochs"] = -(-epochs // self.iterations_per_call)
        rule, best = given.arguments["stopping_rule"], FiniteBest(lambda: self._first_params)

        def complete(callback: dict[str, Any]) -> None:
            self._complete(callback)
            best.complete(callback)

        given.arguments["stopping_rule"] = CallbackRule(complete, rule, self._finish)
        once = epochs == 1
        if once:  # JaxPlan divides by epochs - 1
            given.arguments["epochs"] = 2
        for callback in super().optimize_generator(*given.args[1:], **given.kwargs):
            if once and not callback["status"].is_terminal():
                budget = JaxPlannerStatus.ITER_BUDGET_REACHED
                callback.update(status=budget, progress=100.0)
            yield callback
            if once:
                return


def _with_equal_types(update: Callable) -> Callable:
    """PGPE's update, called with the same types each time, so that it is compiled once.

    In JaxPlan the first progress is an integer and the first `r_max` weakly typed, the others not.

    Args:
      update: with `r_max` and the progress, in percent, as its third and fourth arguments.
    """

    @functools.wraps(update)
    def typed(key: Any, params: Any, r_max: Array, progress: float, *rest: Any) -> Any:
        return update(key, params, jnp.asarray(r_max, r_max.dtype), float(progress), *rest)

    return typed


def _with_one_flag_each(merge: Callable) -> Callable:
    """JaxPlan's choice between PGPE's parameters and its own, for any number of parallel updates.

    A plan that keeps `max-nondef-actions` says of each step whether its projection has converged;
    JaxPlan's mask has one flag per parallel update, so that with several the shapes don't fit.

    Args:
      merge: with both flags of convergence [parallel updates, ...] as its last two arguments.
    """

    @functools.wraps(merge)
    def merged(*args: Any) -> Any:
        *others, ours, theirs = args
        return merge(*others, *(jnp.all(c.reshape(len(c), -1), axis=1) for c in (ours, theirs)))

    return merged
