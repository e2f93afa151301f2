"""What an action that is sent to the environment breaks, looked at apart from who chose it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.debug.exception import RDDLInvalidActionError

from mdpo_rddl.problem.episode import Verdict
from mdpo_rddl.problem.legality import Referee, action_box

BREACHES = ("type", "box", "count", "precondition")
"""Another shape, another kind of values or a number that is not finite; outside of the box; more
changes than `max-nondef-actions`; a precondition that does not hold."""


class Inspector:
    """A referee whose verdicts are looked at.

    Attributes:
      counts: the actions so far (`steps`); those that the referee `refused`, and of these those
        that it `replaced`; of what was sent those that break each of `BREACHES`, and those that
        break any but were not refused (`unsaid`).
    """

    def __init__(self, env: RDDLEnv) -> None:
        """Reads the rules of a vectorized environment."""
        self._env, self._referee = env, Referee(env)
        self._box, self._noop = action_box(env), env.sampler.noop_actions
        self.counts = dict.fromkeys(("steps", "refused", "replaced", *BREACHES, "unsaid"), 0)

    def rule(self, proposal: Mapping[str, Any]) -> Verdict:
        """The referee's verdict."""
        verdict = self._referee.rule(proposal)
        broken = self.broken(verdict.actions)
        self.counts["steps"] += 1
        self.counts["refused"] += verdict.illegal
        self.counts["replaced"] += verdict.fallback
        self.counts["unsaid"] += bool(broken) and (verdict.fallback or not verdict.illegal)
        for name in broken:
            self.counts[name] += 1
        return verdict

    def broken(self, actions: Mapping[str, Any]) -> set[str]:
        """Which of `BREACHES` an action breaks in the environment's state."""
        if any(self._is_mistyped(name, value) for name, value in actions.items()):
            return {"type"}
        found = set()
        if any(self._is_outside(name, value) for name, value in actions.items()):
            found.add("box")
        sampler = self._env.sampler
        prepared = sampler.prepare_actions_for_sim(dict(actions))
        try:
            sampler.check_default_action_count(prepared, self._env.enforce_count_non_bool)
        except RDDLInvalidActionError:
            found.add("count")
        if not sampler.check_action_preconditions(prepared, silent=True):
            found.add("precondition")
        return found

    def _is_mistyped(self, name: str, given: Any) -> bool:
        value, model = np.asarray(given), self._env.model
        if name not in self._noop or value.shape != np.shape(self._noop[name]):
            return True
        kind = model.action_ranges[name]
        if kind in model.type_to_objects:  # by their names or their places
            objects = model.type_to_objects[kind]
            among = objects if value.dtype.kind == "U" else range(len(objects))
            return value.dtype.kind not in "Uiu" or not np.all(np.isin(value, list(among)))
        kinds = {"bool": "b", "int": "iu", "real": "f"}[kind]
        return value.dtype.kind not in kinds or not np.all(np.isfinite(value))

    def _is_outside(self, name: str, given: Any) -> bool:
        """Compared as numbers of 64 bits."""
        if self._env.model.action_ranges[name] not in ("int", "real"):
            return False
        value = np.asarray(given)
        value = value.astype(float) if value.dtype.kind == "f" else value
        lower, upper = self._box[name]
        return bool(np.any(value < lower) or np.any(value > upper))
