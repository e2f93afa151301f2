"""Many iterations in one compiled call.

JaxPlan's loop dispatches every iteration from Python, and tests the parameters after each.
Here one turn of that loop is a call of several blocks, each of `test_every` iterations and one
test. The random keys of an iteration and of a test are those that JaxPlan's loop would use, so
the parameters are the same, but for the order of floating-point operations.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax, random
from jax.sharding import NamedSharding

from mdpo_rddl.planner.update.sharding import replicated, shard
from mdpo_rddl.planner.update.sizes import CallSizes


class Best(NamedTuple):
    """The best tested iterate so far, as JaxPlan chooses it.

    A restart whose test loss is not a number counts as infinitely bad.

    Attributes:
      losses: the last W test losses per restart [W, R].
      tests: number of tests so far.
      smooth_loss: mean of the last W test losses per restart [R].
      loss: smallest of all smoothed losses.
      params, grad: of the best iterate, without the restarts' axis.
      restart: its restart.
      iteration: its iteration, from 0.
    """

    losses: Array
    tests: Array
    smooth_loss: Array
    loss: Array
    params: Any
    grad: Any
    restart: Array
    iteration: Array


class CallState(NamedTuple):
    """What a call hands on to the next one.

    Attributes:
      key: the key that JaxPlan's loop would hold.
      done, total: iterations done and to do.
      test_fluents: batched initial fluents and non-fluents of the test rollouts.
      test_model: the exact model's parameters.
      best: the best iterate.
      watched: that of the restarts that a stopping rule is shown, if those are not all.
    """

    key: Array
    done: Array
    total: Array
    test_fluents: tuple[Any, Any]
    test_model: Any
    best: Best
    watched: Best | None


class Turn(NamedTuple):
    """What one call shows JaxPlan's loop besides the update's own results.

    Attributes:
      test_loss, test_log: of the last test, as JaxPlan's `test_loss` gives them.
    """

    test_loss: Array
    test_log: Any


def make_call(
    update: Callable, test_loss: Callable, sharding: NamedSharding | None = None
) -> Callable:
    """Makes calls of any number of blocks of any length.

    Args:
      update: JaxPlan's batched update, or one with its arguments and results.
      test_loss: JaxPlan's batched test loss.
      sharding: how the restarts lie on several devices.

    Returns:
      A pure function call(blocks, test_every, state, params, hyperparams, fluents, nonfluents,
      model, critic, opt_state, opt_aux), which gives the update's results of the last iteration,
      the `CallState` and the `Turn`. It stops after `state.total` iterations; at least one must
      be left.
    """

    def call(blocks, test_every, state, params, hyperparams, *rest):
        fluents, nonfluents, model, critic, opt_state, opt_aux = rest
        shared = (hyperparams, fluents, nonfluents)

        def iterate(_, carry):
            key, _, (params, _, opt_state, opt_aux, _, _, model, _) = carry
            key, subkey = random.split(key)
            results = update(subkey, params, *shared, model, critic, opt_state, opt_aux)
            return key, subkey, results

        def test(subkey, params, test_model):
            loss, (log, test_model) = test_loss(
                subkey, params, hyperparams, *state.test_fluents, test_model, critic
            )
            return loss, log, test_model

        def block(_, carry):
            state, subkey, results, _ = carry
            count = jnp.minimum(test_every, state.total - state.done)
            key, subkey, results = lax.fori_loop(0, count, iterate, (state.key, subkey, results))
            done = state.done + count
            loss, log, test_model = test(subkey, results[0], state.test_model)
            best = _updated(state.best, loss, results[0], results[5]["grad"], done - 1)
            watched = state.watched
            if watched is not None:
                tested = loss, results[0], results[5]["grad"]
                first = jax.tree.map(lambda leaf: leaf[: watched.losses.shape[1]], tested)
                watched = _updated(watched, *first, done - 1)
            state = state._replace(
                key=key, done=done, test_model=test_model, best=best, watched=watched
            )
            return state, subkey, results, Turn(loss, log)

        results = jax.eval_shape(
            update, state.key, params, *shared, model, critic, opt_state, opt_aux
        )
        results = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), results)
        # only what the first iteration reads of "the results before" matters
        results = (params, results[1], opt_state, opt_aux, *results[4:6], model, results[7])
        loss, log, _ = jax.eval_shape(test, state.key, params, state.test_model)
        turn = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), Turn(loss, log))
        left = -((state.done - state.total) // test_every)  # rounded up
        start = (state, state.key, results, turn)
        state, _, results, turn = lax.fori_loop(0, jnp.minimum(blocks, left), block, start)
        if sharding is not None:  # as they came in, or the next call would be compiled anew
            results = lax.with_sharding_constraint(results, sharding)
            state = lax.with_sharding_constraint(state, replicated(sharding))
        return results, state, turn

    return call


def _updated(best: Best, loss: Array, params: Any, grad: Any, iteration: Array) -> Best:
    window = best.losses.shape[0]
    losses = lax.dynamic_update_index_in_dim(best.losses, loss, best.tests % window, axis=0)
    tests = best.tests + 1
    smooth = jnp.sum(losses, axis=0) / jnp.minimum(tests, window)
    comparable = jnp.where(jnp.isfinite(smooth), smooth, jnp.inf)
    index = jnp.argmin(comparable)
    is_better = comparable[index] < best.loss

    def choose(new: Any, old: Any) -> Any:
        return jax.tree.map(lambda n, o: jnp.where(is_better, n[index], o), new, old)

    return Best(
        losses=losses,
        tests=tests,
        smooth_loss=smooth,
        loss=jnp.minimum(comparable[index], best.loss),
        params=choose(params, best.params),
        grad=choose(grad, best.grad),
        restart=jnp.where(is_better, index, best.restart),
        iteration=jnp.where(is_better, iteration, best.iteration),
    )


def _of_first(best: Best, restarts: int) -> Best:
    """A best iterate before the first test, of fewer restarts."""
    return best._replace(losses=best.losses[:, :restarts], smooth_loss=best.smooth_loss[:restarts])


def _not_compiled(*_: Any) -> Any:
    raise RuntimeError("the calls are not compiled yet")


class Calls:
    """A planner's calls, and what of them outlives one turn of JaxPlan's loop.

    Attributes:
      test_fluents: batched initial fluents and non-fluents of the test rollouts.
    """

    def __init__(self) -> None:
        self.test_fluents: tuple[Any, Any] | None = None
        self._beginning: tuple[Array, int, int] | None = None
        self._function = self._call = _not_compiled
        self._plain_test_loss: Callable[..., Any] = _not_compiled
        self._sharding: NamedSharding | None = None
        self._state: Any = None
        self._turn: Turn | None = None

    def compile(
        self, update: Callable, test_loss: Callable, sharding: NamedSharding | None
    ) -> None:
        """Compiles the calls: see `make_call`."""
        self._function = make_call(update, test_loss, sharding)
        self.compile_with(jax.jit)
        self._plain_test_loss, self._sharding = test_loss, sharding

    def compile_with(self, jit: Callable[[Callable], Callable]) -> None:
        """Compiles the calls by something that stands in for `jax.jit`."""
        self._call = jit(self._function)

    def begin(self, arguments: dict[str, Any]) -> None:
        """Notes what JaxPlan's loop is about to be called with; adds a key from the clock.

        Args:
          arguments: of `optimize_generator`, complete.
        """
        if arguments["key"] is None:
            arguments["key"] = random.PRNGKey(round(time.time() * 1000))
        names = ("key", "epochs", "test_rolling_window")
        self._beginning = tuple(arguments[name] for name in names)

    def first_state(
        self, params: Any, test_model: Any, is_warm: bool, watched: int | None = None
    ) -> CallState:
        """The state before the first iteration.

        Args:
          params: the initial parameters, with a leading axis of restarts [R, ...].
          test_model: the exact model's parameters, with that axis.
          is_warm: whether they were given, so that JaxPlan has used no key for them.
          watched: how many of the restarts, the first ones, a stopping rule is shown; all if None.
        """
        key, total, window = self._beginning or (random.PRNGKey(0), 1, 1)
        restarts = jax.tree.leaves(params)[0].shape[0]
        # in numpy, for which nothing is compiled
        one = jax.tree.map(lambda leaf: np.asarray(leaf)[0], params)
        infinite: Any = np.full((restarts,), np.inf, jnp.result_type(float))
        losses: Any = np.zeros((window, restarts), infinite.dtype)
        zero: Any = np.zeros((), np.int32)
        best = Best(
            losses=losses,
            tests=zero,
            smooth_loss=infinite,
            loss=infinite[0],
            params=one,
            grad=jax.tree.map(np.zeros_like, one),
            restart=zero,
            iteration=zero,
        )
        state = CallState(
            key=key if is_warm else random.split(key)[0],
            done=zero,
            total=zero + np.int32(total),
            test_fluents=jax.tree.map(np.asarray, self.test_fluents),
            test_model=test_model,
            best=best,
            watched=None if watched is None else _of_first(best, watched),
        )
        return state if self._sharding is None else shard(state, replicated(self._sharding))

    def update(self, sizes: Callable[[], CallSizes], *arguments: Any) -> tuple[Any, ...]:
        """One call in place of JaxPlan's update; the key that JaxPlan gives is not used.

        Args:
          sizes: gives those of the call.
          *arguments: of JaxPlan's update.
        """
        _, *rest, opt_aux = arguments
        size = sizes()
        others = {name: value for name, value in opt_aux.items() if name != "call"}
        results, self._state, self._turn = self._call(
            size.iterations // size.test_every, size.test_every, opt_aux["call"], *rest, others
        )
        opt_aux = {**results[3], "call": self._state}
        return (*results[:3], opt_aux, *results[4:])

    def test_loss(self, *arguments: Any) -> Any:
        """The test that the call has made, or else JaxPlan's own test loss."""
        turn, self._turn = self._turn, None
        if turn is None:
            return self._plain_test_loss(*arguments)
        return turn.test_loss, (turn.test_log, arguments[5])

    def callback_entries(self) -> dict[str, Any]:
        """The entries of JaxPlan's callback that a call of several iterations knows better."""
        return self._entries(self._state.best)

    def watched_entries(self) -> dict[str, Any]:
        """The same of the restarts that a stopping rule is shown."""
        return self._entries(self._state.watched)

    def _entries(self, best: Best) -> dict[str, Any]:
        state = self._state
        return {
            "iteration": int(state.done) - 1,
            "key": state.key,
            "test_return": -np.asarray(best.smooth_loss),
            "best_return": -np.asarray(best.loss),
            "last_iteration_improved": int(best.iteration),
            "best_params": best.params,
            "best_grad": best.grad,
            "best_index": int(best.restart),
        }
