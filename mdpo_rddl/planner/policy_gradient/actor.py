"""The feedback policy as a law of actions whose likeliest action is the one that it plays."""

import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.plans.feedback_plan import in_order
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.planner.plans.limits import choose_within_limits
from mdpo_rddl.planner.policy_gradient.few_true import FewTrue
from mdpo_rddl.problem.limits import group_limits

# of log-odds: beyond that a gradient has nothing left to say
_LARGEST_WEIGHT = 20.0
_FORBIDDEN_WEIGHT = -30.0


def can_be_drawn(rddl: Any) -> bool:
    """Whether there is such a law: all actions are bools, and the state is observed.

    Args:
      rddl: pyRDDLGym's lifted model.
    """
    kinds = {rddl.variable_ranges[name] for name in rddl.action_fluents}
    return kinds == {"bool"} and not rddl.observ_fluents


class Actor:
    """Draws which bools leave the no-op.

    The weights of the law are the log-odds of the deterministic policy, so that this plays the
    likeliest proposal. A proposal is made legal as in all other rollouts, and is drawn again from
    the same noise by whoever learns: the law's probability is the proposal's, not that of what
    was played instead.

    Attributes:
      law: of the bools of all action fluents, side by side.
    """

    def __init__(self, planner: MDPOPlanner) -> None:
        """Reads the limits.

        Args:
          planner: compiled, with a `FeedbackPlan`, of a model that `can_be_drawn`.
        """
        plan, compiled = planner.feedback_plan, planner.test_compiled
        self._plan, self._shapes = plan, plan.feedback.action_shapes
        self._limits = [*group_limits(planner.rddl)[0], *plan.concurrency]
        self._legal = LegalActions(compiled, self._limits)
        self._noop = {n: np.asarray(compiled.init_values[n]).astype(bool) for n in self._shapes}
        size = sum(math.prod(shape) for shape in self._shapes.values())
        most = planner.rddl.max_allowed_actions if plan.concurrency else size
        self.law = FewTrue(size, int(min(most, size)))

    def weights(self, params: Params, state: Mapping[str, Array], step: Any) -> Array:
        """Of the law in a state [n]; of what is forbidden there, very small.

        Args:
          params: of the feedback policy.
          state: per fluent [*shape].
          step: of the rollout, from 0.
        """
        odds = self._plan.log_odds(params, state, step)
        weights = jnp.clip(self._flat(odds), -_LARGEST_WEIGHT, _LARGEST_WEIGHT)
        allowed = self._legal.allowed(state)
        if not allowed:
            return weights
        # what may be true; a bool that is true in the no-op leaves it to become false
        free = {n: jnp.ones(shape, bool) for n, shape in self._shapes.items()} | allowed
        free = {n: free[n] | self._noop[n] for n in free}
        return jnp.where(self._flat(free), weights, _FORBIDDEN_WEIGHT)

    def act(self, params: Params, state: Mapping[str, Array], step: Any, noise: Array) -> Any:
        """A legal action drawn from the law, per fluent [*shape].

        Args:
          params, state, step: as of `weights`.
          noise: of the law.
        """
        weights = self.weights(params, state, step)
        chosen = self.law.draw(noise, weights)
        left = self._tree(chosen)
        proposal = {name: left[name] ^ self._noop[name] for name in self._shapes}
        if not (self._limits or self._legal.is_needed):
            return proposal
        # what was proposed is likelier than what was not
        half = 0.5 * in_order(self.law.ranks(noise, weights))
        leaving = self._tree(jnp.where(chosen, 0.5 + half, half))
        true = {n: jnp.where(self._noop[n], 1.0 - leaving[n], leaving[n]) for n in self._shapes}
        proposal |= choose_within_limits(true, self._limits)
        return self._legal(proposal, true, state) if self._legal.is_needed else proposal

    def _flat(self, tree: Mapping[str, Array]) -> Array:
        return jnp.concatenate([jnp.ravel(tree[name]) for name in self._shapes])

    def _tree(self, flat: Array) -> dict[str, Array]:
        tree, start = {}, 0
        for name, shape in self._shapes.items():
            end = start + math.prod(shape)
            tree[name] = jnp.reshape(flat[start:end], shape)
            start = end
        return tree
