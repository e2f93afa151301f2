"""The arm that learns from exact rollouts: a policy gradient by likelihood ratios (PPO)."""

import math
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jax import Array

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.learning import LearningArm, Span
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.draws import Draws
from mdpo_rddl.auto.state import count_of
from mdpo_rddl.planner.plans.feedback import Params, with_raw_scale
from mdpo_rddl.planner.policy_gradient.ppo import Learner, Pace, PolicyGradient, Shown
from mdpo_rddl.planner.programs.quick import is_short, quick_jit

PPO = "ppo"
# of the first phase: Adam's step size, and the worth of a nat in units of the advantage
_STEP, _ENTROPY = 5e-3, 0.02
# of both: in a phase that goes on from a policy, and in the one after it if that found nothing
_LATER, _SMALLER = 0.3, 0.5
# nats: a law of less tries nothing any more
_NO_ENTROPY = 0.005
# of a phase: when the bonus for the entropy ends; of the step size, what is left in the end
_NO_BONUS, _LAST_STEP = 0.8, 0.02
# of a policy to go on from: nats for each proposal, found by so many bisections, in such a share
# of a slice
_EXPLORING_ENTROPY, _BISECTIONS, _SMALLEST_SCALE, _SCALING_SHARE = 0.2, 8, 1e-3, 0.25
_MOST_PHASES = 10**6
_STILL = Pace(0.0, 0.0)


class PolicyGradientArm(LearningArm[Learner]):
    """Learns the arena's own policy as a law of actions, and offers its likeliest actions.

    The first phase begins at the no-op. The next ones begin at the best policy so far of the
    arena's planner, or at the arm's own if that one has an open-loop plan, which is not learnt; its
    raw actions are scaled down until its law explores. Within a phase, step size and bonus fall.
    The first one ends with its time, a later one with a slice that finds nothing better; either
    once its law explores no more.
    """

    descends = True

    def __init__(self, arena: Arena, until: float) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common; all actions are bools, the state is observed.
          until: when the first phase ends, by the clock.
        """
        super().__init__(PPO, Draws.PPO, arena, until)
        self._phases = 0
        # of the phase: what it goes on from, None for the no-op; and of its step size and bonus
        self._parent: Candidate | None = None
        self._factor = 1.0
        self._is_better = self._has_collapsed = False

    def judged(self, candidate: Candidate) -> None:
        """Is told what the judge says, and whether it is the best so far."""
        super().judged(candidate)
        self._is_better = candidate is self._arena.judge.incumbent

    def _build(self) -> Learner:
        """Makes the law too."""
        arena = self._arena
        jit = quick_jit if is_short(arena.seconds) else None
        self._gradient = PolicyGradient(arena.planner, jit=jit)
        begun = self._gradient.begin(arena.noop, self._learner_key)
        jax.block_until_ready(self._iterated(begun, self._trial_key, _STILL))
        return begun

    def _values(self) -> dict[str, Any]:
        return {"phases": self._phases, "factor": self._factor}

    def _take(self, values: Mapping[str, Any]) -> None:
        phases, factor = count_of(values["phases"]), float(values["factor"])
        if not 1 <= phases <= _MOST_PHASES:
            raise ValueError(f"it has {phases} phases")
        if not 0.0 < factor <= 1.0:
            raise ValueError(f"its step is {factor} of the first one's")
        # it was stopped in the middle of a phase, which goes on
        self._phases, self._factor, self._is_better = phases, factor, True

    def _enter(self, until: float) -> None:
        if not self._goes_on():
            self._begin_phase(until)
        self._is_better = False

    def _goes_on(self) -> bool:
        """Whether the phase has more to find."""
        if self._learner is None or self._has_collapsed:
            return False
        is_in_time = self._clock() < self._span.ends
        return is_in_time and (self._phases == 1 or self._is_better)

    def _pace(self, now: float) -> Pace:
        done = self._span.share(now)
        step = _STEP * max(_LAST_STEP, 1.0 - done)
        bonus = _ENTROPY * max(0.0, 1.0 - done / _NO_BONUS)
        return Pace(self._factor * step, self._factor * bonus)

    def _iterated(self, learner: Learner, key: Array, pace: Pace) -> tuple[Learner, Shown]:
        return self._gradient.iterate(learner, key, pace)

    def _note(self, played: Learner, shown: Shown) -> None:
        self._has_collapsed = float(shown.entropy) < _NO_ENTROPY

    @property
    def _is_settled(self) -> bool:
        return self._has_collapsed

    def _begin_phase(self, until: float) -> None:
        arena, now = self._arena, self._clock()
        is_first = not self._phases
        parent = None if is_first else arena.incumbent
        if parent is not None and _has_plan(parent.params):
            parent = None
        best = self._earlier_params(arena.planner) if parent is None else parent.params
        ends_by = now + _SCALING_SHARE * (until - now)
        params = arena.noop if best is None else self._exploring(best, ends_by)
        ends = self._first_ends() if is_first else arena.deadline
        factor = 1.0 if best is None else _LATER
        if self._phases > 1 and not self._is_better:
            factor = _SMALLER * self._factor
        self._has_collapsed = False
        self._parent, self._factor, self._span = parent, factor, Span(now, ends)
        self._phases += 1
        key = jax.random.fold_in(self._learner_key, self._phases)
        self._learner = self._gradient.begin(params, key)

    def _exploring(self, params: Params, until: float) -> Params:
        """A policy with the same likeliest actions, whose law explores; looked for till then."""
        low, high = math.log(_SMALLEST_SCALE), 0.0
        for _ in range(_BISECTIONS):
            if self._clock() + self._iteration_seconds > until:
                break
            middle, key = 0.5 * (low + high), self._trial_key
            learner = self._gradient.begin(with_raw_scale(params, math.exp(middle)), key)
            _, shown = self._iterated(learner, key, _STILL)
            explores = float(shown.entropy) > _EXPLORING_ENTROPY
            low, high = (middle, high) if explores else (low, middle)
        return with_raw_scale(params, math.exp(0.5 * (low + high)))

    def _offer_learnt(self) -> None:
        assert self._learner is not None
        params = jax.tree.map(np.asarray, self._learner.params)
        self._offer_child(self._parent, f"ppo, phase {self._phases}", params)


def _has_plan(params: Params) -> bool:
    return any(np.any(leaf) for leaf in jax.tree.leaves(params.get("plan", {})))
