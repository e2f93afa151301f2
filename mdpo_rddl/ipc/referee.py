"""What counts as a legal action in a run."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.problem.legality import action_box


class IllegalActionError(Exception):
    """An action that the environment cannot take, whatever the rules say."""


class Ruling(NamedTuple):
    """What the referee makes of a planner's action.

    Attributes:
      actions: per action fluent, the tensor to play.
      is_violation: whether a precondition of the domain does not hold.
    """

    actions: dict[str, Any]
    is_violation: bool


class ContestReferee:
    """Rules on actions in the current state of one environment."""

    def __init__(self, env: RDDLEnv) -> None:
        """Reads the action box of a vectorized environment."""
        self._env = env
        ranges, box = env.model.action_ranges, action_box(env)
        self._box = {name: box[name] for name, kind in ranges.items() if kind == "real"}

    def rule(self, proposal: Mapping[str, Any]) -> Ruling:
        """Completes an action and checks it.

        A planner that computes in 32 bit cannot hit a bound that only 64 bit can hold: a real
        that is the bound but for that rounding counts as the bound.

        Raises:
          IllegalActionError: naming the cause, if the action has another form than the
            problem's, is not finite, or exceeds `max-nondef-actions`.
        """
        sampler = self._env.sampler
        try:
            actions = sampler.prepare_actions_for_sim(dict(proposal))
            sampler.check_default_action_count(actions, self._env.enforce_count_non_bool)
        except Exception as error:  # pyRDDLGym's errors have no base, and some are accidents
            raise IllegalActionError(str(error) or type(error).__name__) from error
        for name, (lower, upper) in self._box.items():
            given = np.asarray(actions[name], np.float64)
            if not np.all(np.isfinite(given)):
                raise IllegalActionError(f"{name} is not finite")
            inside = np.clip(given, lower, upper)
            is_rounded = given.astype(np.float32) == inside.astype(np.float32)
            actions[name] = np.where(is_rounded, inside, given)
        holds = sampler.check_action_preconditions(actions, silent=True)
        return Ruling(actions, is_violation=not holds)
