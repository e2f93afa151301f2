"""Paired rollouts of candidates, compiled, in calls whose duration is known."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.continuations import Continuations, Size
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.policy import Policy

WIDE, NARROW = "wide", "narrow"
# candidates of a call, the base among them; the rest of its size are scenarios
_CANDIDATES = {WIDE: 32, NARROW: 4}
_ROLLOUTS, _FEWEST, _MOST = 512, 128, 4096
# of the time of a decision, and at most, a call may take
_SHARE, _LONGEST_SECONDS = 0.1, 0.05
_MARGIN, _FORGETTING = 1.2, 0.98
_LEGALITY_BATCH = 64
# a return that is not finite must not look like a gain
_NOT_FINITE = -1e30


class Simulator:
    """Compiles everything that a decision needs, and knows how long it takes."""

    def __init__(
        self, policy: Policy, depth: int, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Compiles nothing yet.

        Args:
          policy: what plays after the first actions.
          depth: steps k of a candidate.
          clock: tells the seconds.
        """
        self.policy, self.depth = policy, depth
        self.components = Components.of(policy.planner)
        self.horizon = policy.planner.rddl.horizon
        self._clock = clock
        self._continuations = Continuations(policy.planner)
        self._legality = self._continuations.compile_legality()
        self._programs: dict[str, Callable[..., Any]] = {}
        self._sizes: dict[str, Size] = {}
        self._overhead: dict[str, float] = {}
        self._per_step: dict[str, float] = {}
        hyperparams = dict(policy.policy_hyperparams)
        self._policy_arguments = jax.device_put((policy.params, hyperparams))

    def prepare(self, state: Mapping[str, Any], seconds: float) -> None:
        """Compiles the calls for a decision of so many seconds, and measures them.

        Args:
          state: any state, as the environment shows it.
          seconds: of a decision.
        """
        longest = min(_LONGEST_SECONDS, _SHARE * seconds)
        base = self.components.flat(self.policy(0, state))
        self.legal(state, base[np.newaxis])
        rollouts = _ROLLOUTS
        self._compile(WIDE, rollouts, state, base)
        took = self.seconds(WIDE, 0)
        if not longest / 3 < took < longest * 1.5:
            rollouts = int(np.clip(rollouts * longest / took, _FEWEST, _MOST))
            self._compile(WIDE, rollouts, state, base)
        self._compile(NARROW, rollouts, state, base)

    def scenarios(self, kind: str) -> int:
        """Scenarios of one call."""
        return self._sizes[kind].scenarios

    def challengers(self, kind: str) -> int:
        """Candidates of one call, the base not counted."""
        return self._sizes[kind].candidates - 1

    def seconds(self, kind: str, step: int) -> float:
        """How long a call at a step is likely to take."""
        steps = max(1, self.horizon - step)
        return _MARGIN * (self._overhead[kind] + steps * self._per_step[kind])

    def legal(self, state: Mapping[str, Any], actions: np.ndarray) -> np.ndarray:
        """Which of the actions [M, D] are legal [M]."""
        known = self._numbers(state)
        verdicts = []
        for start in range(0, len(actions), _LEGALITY_BATCH):
            batch = actions[start : start + _LEGALITY_BATCH]
            missing = _LEGALITY_BATCH - len(batch)
            padded = np.concatenate([batch, np.repeat(batch[:1], missing, axis=0)])
            verdicts.append(
                np.asarray(self._legality(known, jax.numpy.asarray(padded)))[: len(batch)]
            )
        return np.concatenate(verdicts) if verdicts else np.zeros(0, bool)

    def gains(
        self, kind: str, state: Mapping[str, Any], step: int, candidates: np.ndarray, seed: int
    ) -> np.ndarray:
        """What candidates return more than the first of them, on common scenarios.

        Args:
          kind: of the call.
          state: as the environment shows it.
          step: its number.
          candidates: the base and at most `challengers(kind)` others [n + 1, k, D].
          seed: of the scenarios.

        Returns:
          The differences of the discounted returns to the horizon [n, N].
        """
        size = self._sizes[kind]
        missing = size.candidates - len(candidates)
        padded = np.concatenate([candidates, np.repeat(candidates[:1], missing, axis=0)])
        started = self._clock()
        key = jax.random.PRNGKey(seed)
        arguments = self._numbers(state), step, padded.astype(np.float32)
        returns = np.asarray(self._programs[kind](key, *self._policy_arguments, *arguments))
        self._measure(kind, step, self._clock() - started)
        differences = (returns[1 : len(candidates)] - returns[:1]).astype(float)
        return np.where(np.isfinite(differences), differences, _NOT_FINITE)

    def _measure(self, kind: str, step: int, seconds: float) -> None:
        if kind not in self._per_step:
            return
        steps = max(1, self.horizon - step)
        seen = max(0.0, seconds - self._overhead[kind]) / steps
        self._per_step[kind] = max(_FORGETTING * self._per_step[kind], seen)

    def _compile(self, kind: str, rollouts: int, state: Mapping[str, Any], base: Any) -> None:
        self._per_step.pop(kind, None)
        count = _CANDIDATES[kind]
        size = self._sizes[kind] = Size(count, max(2, rollouts // count))
        self._programs[kind] = self._continuations.compile(size)
        candidates = np.zeros((1, self.depth, self.components.size), np.float32)
        candidates[0, 0] = base

        def call(step: int, seed: int) -> float:
            started = self._clock()
            self.gains(kind, state, step, candidates, seed)
            return self._clock() - started

        call(0, 0)
        last, steps = self.horizon - 1, self.horizon
        self._overhead[kind] = min(call(last, seed) for seed in range(1, 4))
        whole = float(np.median([call(0, seed) for seed in range(1, 4)]))
        self._per_step[kind] = max(0.0, whole - self._overhead[kind]) / steps

    def _numbers(self, state: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The state with objects as their numbers."""
        rddl, numbers = self.policy.planner.rddl, {}
        for name, value in state.items():
            array = np.asarray(value)
            if array.dtype.kind in "UO":
                array = rddl.object_string_to_index_array(rddl.variable_ranges[name], array)
            numbers[name] = array
        return numbers
