"""What counts as a legal action in a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv

from mdpo_rddl.problem.episode import Verdict
from mdpo_rddl.problem.legality import action_box


class IllegalActionError(Exception):
    """An action that ends the trial: the environment or the rules refuse it."""


class ViolationError(IllegalActionError):
    """An action that breaks a precondition of the domain."""


class ContestReferee:
    """Rules on actions in the current state of one environment; replaces none."""

    def __init__(self, env: RDDLEnv, lenient: bool) -> None:
        """Reads the action box of a vectorized environment.

        Args:
          env: the environment of the trial.
          lenient: whether an action that breaks a precondition is played all the same.
        """
        self._env, self._lenient = env, lenient
        ranges, box = env.model.action_ranges, action_box(env)
        self._box = {name: box[name] for name, kind in ranges.items() if kind == "real"}

    def rule(self, proposal: Mapping[str, Any]) -> Verdict:
        """Completes an action and checks it.

        A planner that computes in 32 bit cannot hit a bound that only 64 bit can hold: a real
        that is the bound but for that rounding counts as the bound.

        Raises:
          IllegalActionError: naming the cause, if the action has another form than the
            problem's, is not finite, or exceeds `max-nondef-actions`.
          ViolationError: if it breaks a precondition, unless the trial is lenient.
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
        if not holds and not self._lenient:
            raise ViolationError("a precondition of the domain does not hold")
        return Verdict(actions, illegal=not holds)
