"""The reward with goals counted: how many of the conditions hold that must hold all at once.

A reward that depends on whether all of many conditions hold says nothing until the last one does.
Counted, each of them counts: the goal-count heuristic (Bonet and Geffner, "Planning as heuristic
search", 2001), for a `forall`, and for an `exists` that must become false, of any reward.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial, reduce
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.planner.model.exact_model import ExactModel
from mdpo_rddl.planner.model.repairs import Evaluated
from mdpo_rddl.planner.programs.quick import once_jit
from mdpo_rddl.planner.upstream import JaxRDDLCompiler

CountedReward = Callable[[Mapping[str, Any], Mapping[str, Any], Any, Array], Array]
"""Of fluents, non-fluents, the model's parameters and a random key; a scalar."""


def counted_reward(exact: JaxRDDLCompiler) -> CountedReward | None:
    """The reward of one step with its goals counted; None where there is none.

    Nor is there where a termination condition may end the episode: who is rewarded for a part at
    each step would put off what ends it.

    A goal is a `forall` that does not hold at first, or an `exists` that does, of conditions on
    the state, and one of the whole problem: inside of another aggregation each object has its own
    reward already. In the initial state it must not cost anything to reach it. Where it stands,
    there is the share of its conditions that have changed since the start: 0 there and 1 once it is
    reached. What it is joined with follows: ~x is 1 - x, of what `^` joins the mean counts, while
    what reads actions must hold, of what `|` joins the largest, and `if` lies between its branches.

    Args:
      exact: the exact model, compiled.
    """
    if exact.rddl.terminations:
        return None
    found = _GoalCounting(exact).paid_goals()
    if not found:
        return None
    evaluated = _GoalCounting(exact, found).compiled_reward()

    def reward(
        fluents: Mapping[str, Any], nonfluents: Mapping[str, Any], params: Any, key: Array
    ) -> Array:
        return jnp.asarray(evaluated(fluents, nonfluents, params, key)[0])

    return reward


class _GoalCounting(ExactModel):
    """Compiles expressions as the exact model does, but for goals.

    Attributes:
      goals: the numbers of those that were compiled.
    """

    def __init__(self, exact: JaxRDDLCompiler, only: Collection[int] | None = None) -> None:
        """Compiles nothing yet.

        Args:
          exact: the exact model, compiled.
          only: the goals that are counted; all if None.
        """
        # what was traced of the problem is the same, and takes long on a large one
        self.__dict__.update(vars(exact))
        self._only, self.goals = only, set[int]()
        # in place of the shares, where these are not computed
        self._shares: Mapping[int, Array] | None = None

    def compiled_reward(self) -> Evaluated:
        """The reward with goals counted."""
        evaluated: Evaluated = self._jax(self.rddl.reward, self.model_aux, dtype=self.REAL)
        return evaluated

    def paid_goals(self) -> set[int]:
        """Those that take nothing from the reward of the initial state's no-op if reached alone."""
        evaluated = self.compiled_reward()
        goals = sorted(self.goals)
        if not goals:
            return set()
        fluents, nonfluents = self.split_fluent_nonfluent(self._first_values())
        params = self.model_aux["params"]

        def rewarded(shares: Array) -> Array:
            self._shares = dict(zip(goals, shares, strict=True))
            found = evaluated(fluents, nonfluents, params, random.PRNGKey(0))[0]
            self._shares = None
            return jnp.asarray(found)

        program = once_jit(rewarded)
        none = program(np.zeros(len(goals), np.float32))
        each = [program(shares) for shares in np.eye(len(goals), dtype=np.float32)]
        return {goal for goal, reward in zip(goals, each, strict=True) if not reward < none}

    def _jax_forall(self, expr: Any, aux: Any) -> Evaluated:
        return self._counted(expr, aux, reached=1.0) or super()._jax_forall(expr, aux)

    def _jax_exists(self, expr: Any, aux: Any) -> Evaluated:
        return self._counted(expr, aux, reached=0.0) or super()._jax_exists(expr, aux)

    def _counted(self, expr: Any, aux: Any, reached: float) -> Evaluated | None:
        """What counts a goal; None if it is none.

        Args:
          expr: the quantified expression.
          aux: of the model.
          reached: the share of true conditions at which it is reached.
        """
        first = self._first_share(expr)
        is_left_out = self._only is not None and expr.id not in self._only
        if is_left_out or first is None or first == reached:
            return None
        conditions = self._jax(expr.args[-1], aux)
        self.goals.add(expr.id)

        def share(fluents: Any, nonfluents: Any, params: Any, key: Any) -> tuple:
            if self._shares is not None:
                known = jnp.asarray(self._shares[expr.id], self.REAL)
                return known if reached else 1.0 - known, key, 0, params
            holds, key, error, params = conditions(fluents, nonfluents, params, key)
            progress = (jnp.mean(jnp.asarray(holds, self.REAL)) - first) / (reached - first)
            # an `exists` begins as true
            return progress if reached else 1.0 - progress, key, error, params

        return share

    def _first_share(self, expr: Any) -> float | None:
        """The share of the conditions that hold at first; None for those of an object of its own.

        That is so, too, where they are about actions, which a policy need but choose.
        """
        simulator, values = self.constraints.sim, self._first_values()
        if not self.traced.cached_is_fluent(expr) or self._reads_actions(expr):
            return None
        try:
            with np.errstate(all="ignore"):
                holds = simulator._sample(expr, values)
                conditions = simulator._sample(expr.args[-1], values)
        except Exception:  # what is not known at first, as a draw, is no goal
            return None
        return None if np.ndim(holds) else float(np.mean(conditions))

    def _first_values(self) -> dict[str, Any]:
        """Of all fluents at first, as if the first step changed nothing."""
        values = dict(self.init_values)
        return values | {after: values[name] for name, after in self.rddl.next_state.items()}

    def _reads_actions(self, expr: Any) -> bool:
        kind, name = expr.etype
        if kind == "pvar":
            return name in self.rddl.action_fluents
        return kind != "constant" and any(map(self._reads_actions, _parts(expr)))

    def _jax_not(self, expr: Any, aux: Any) -> Evaluated:
        return self._joined(expr, aux, lambda x: 1.0 - x, jnp.logical_not)

    def _jax_and(self, expr: Any, aux: Any) -> Evaluated:
        are_chosen = [self._reads_actions(each) for each in expr.args]
        return self._joined(expr, aux, partial(_mean_where_chosen, are_chosen), jnp.logical_and)

    def _jax_or(self, expr: Any, aux: Any) -> Evaluated:
        return self._joined(expr, aux, _largest, jnp.logical_or)

    def _jax_implies(self, expr: Any, aux: Any) -> Evaluated:
        def exact(x: Array, y: Array) -> Array:
            return jnp.logical_or(jnp.logical_not(x), y)

        return self._joined(expr, aux, lambda x, y: _largest(1.0 - x, y), exact)

    def _jax_if(self, expr: Any, aux: Any) -> Evaluated:
        evaluated = [self._jax(each, aux) for each in expr.args]

        def between(fluents: Any, nonfluents: Any, params: Any, key: Any) -> tuple:
            given, key, errors, params = _each(evaluated, fluents, nonfluents, params, key)
            condition, true, false = given
            if _is_share(condition):
                return condition * true + (1.0 - condition) * false, key, errors, params
            return jnp.where(condition, true, false), key, errors, params

        return between

    def _joined(
        self, expr: Any, aux: Any, of_shares: Callable[..., Array], exact: Callable[..., Array]
    ) -> Evaluated:
        """What joins conditions, of which some may be shares."""
        evaluated = [self._jax(each, aux) for each in expr.args]

        def joined(fluents: Any, nonfluents: Any, params: Any, key: Any) -> tuple:
            given, key, errors, params = _each(evaluated, fluents, nonfluents, params, key)
            if any(map(_is_share, given)):
                return of_shares(*(jnp.asarray(x, self.REAL) for x in given)), key, errors, params
            whole = exact(given[0]) if len(given) == 1 else reduce(exact, given)
            return whole, key, errors, params

        return joined


def _parts(expr: Any) -> list[Any]:
    """The expressions that one is made of, without what an aggregation is over."""
    return [each for each in expr.args if hasattr(each, "etype")]


def _each(evaluated: list[Evaluated], fluents: Any, nonfluents: Any, params: Any, key: Any) -> Any:
    """All of them in turn, with one key after the other."""
    values, errors = [], 0
    for one in evaluated:
        value, key, error, params = one(fluents, nonfluents, params, key)
        values.append(value)
        errors |= error
    return values, key, errors, params


def _is_share(value: Any) -> bool:
    return bool(jnp.issubdtype(jnp.result_type(value), jnp.floating))


def _mean_where_chosen(are_chosen: Sequence[bool], *values: Array) -> Array:
    """The mean of the conditions on the state, if those that a policy chooses hold."""
    pairs = list(zip(are_chosen, values, strict=True))
    others = [value for is_chosen, value in pairs if not is_chosen]
    chosen = [value for is_chosen, value in pairs if is_chosen]
    mean = reduce(jnp.add, others) / len(others) if others else jnp.ones(())
    return reduce(jnp.multiply, chosen, mean)


def _largest(*values: Array) -> Array:
    return reduce(jnp.maximum, values)
