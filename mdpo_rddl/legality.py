"""Actions that the exact environment accepts, whatever a policy proposes."""

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.constraints import RDDLConstraints
from pyRDDLGym.core.debug.exception import RDDLInvalidActionError


class Verdict(NamedTuple):
    """What to play.

    Attributes:
      actions: per fluent, the action tensor.
      illegal: whether the proposal, clipped to its box, broke a rule.
      fallback: whether `actions` is the do-nothing action in its place.
    """

    actions: dict[str, Any]
    illegal: bool
    fallback: bool


class Referee:
    """Checks proposals against the current state of one environment."""

    def __init__(self, env: RDDLEnv) -> None:
        """Reads the action box of a vectorized environment."""
        self._env = env
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is no box, already said for `env`
            bounds = RDDLConstraints(env.sampler, vectorized=True).bounds
        ranges = env.model.action_ranges
        self._box = {name: bounds[name] for name, kind in ranges.items() if kind == "real"}
        self._noop = dict(env.sampler.noop_actions)

    def rule(self, proposal: Mapping[str, Any]) -> Verdict:
        """The proposal if it is legal, the do-nothing action if only that is.

        Real actions are clipped to their box in 64 bit first, since a bound rounded to 32 bit
        can lie outside. Where both are illegal, the proposal stands.
        """
        actions = dict(proposal)
        for name, (lower, upper) in self._box.items():
            if name in actions:
                actions[name] = np.clip(np.asarray(actions[name], np.float64), lower, upper)
        if self._is_legal(actions):
            return Verdict(actions, illegal=False, fallback=False)
        if self._is_legal(self._noop):
            return Verdict(dict(self._noop), illegal=True, fallback=True)
        return Verdict(actions, illegal=True, fallback=False)

    def _is_legal(self, actions: Mapping[str, Any]) -> bool:
        sampler = self._env.sampler
        prepared = sampler.prepare_actions_for_sim(actions)
        try:
            sampler.check_default_action_count(prepared, self._env.enforce_count_non_bool)
        except RDDLInvalidActionError:
            return False
        return sampler.check_action_preconditions(prepared, silent=True)
