"""The arm that learns from exact rollouts: a policy gradient by likelihood ratios (PPO)."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.draws import Draws, key_for
from mdpo_rddl.auto.state import State, count_of
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.plans.feedback import Params, with_raw_scale
from mdpo_rddl.planner.policy_gradient.ppo import Learner, Pace, PolicyGradient

PPO = "ppo"
_LEARNER = "learner"
# of the first phase: Adam's step size, and the worth of a nat in units of the advantage
_STEP, _ENTROPY = 5e-3, 0.02
# of both: in a phase that goes on from a policy, and in the one after it if that found nothing
_LATER, _SMALLER = 0.3, 0.5
# of the time left, the least for the first phase
_LEAST_SHARE = 0.25
# nats: a law of less tries nothing any more
_NO_ENTROPY = 0.005
# of a phase: when the bonus for the entropy ends; of the step size, what is left in the end
_NO_BONUS, _LAST_STEP = 0.8, 0.02
# of a policy to go on from: nats for each proposal, found by so many bisections, in such a share
# of a slice
_EXPLORING_ENTROPY, _BISECTIONS, _SMALLEST_SCALE, _SCALING_SHARE = 0.2, 8, 1e-3, 0.25
# iterations in a row from which nothing finite is learnt, after which it is given up
_MOST_LOST = 10
_MOST_PHASES = 10**6
_STILL = Pace(0.0, 0.0)


class _Phase(NamedTuple):
    """Where learning begins, and when its step size and bonus have faded.

    Attributes:
      parent: what it goes on from; None for the no-op.
      began, ends: by the clock.
      factor: of the step size and the bonus.
    """

    parent: Candidate | None
    began: float
    ends: float
    factor: float

    def pace(self, now: float) -> Pace:
        """How far an iteration goes now."""
        done = min(1.0, (now - self.began) / max(self.ends - self.began, 1e-9))
        step = _STEP * max(_LAST_STEP, 1.0 - done)
        bonus = _ENTROPY * max(0.0, 1.0 - done / _NO_BONUS)
        return Pace(self.factor * step, self.factor * bonus)


class PolicyGradientArm(CompilingArm):
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
        super().__init__(PPO, arena)
        keys = jax.random.split(key_for(Draws.PPO, arena.seed), 3)
        self._phase_key, self._iteration_key, self._trial_key = keys
        self._phase: _Phase | None = None
        self._first_until = until
        self._phases = 0
        self._learner: Learner | None = None
        self._means: list[float] = []
        self._is_better = self._has_collapsed = False
        self._lost = 0
        self._iteration_seconds = 0.0
        self._resumed: State | None = None

    @property
    def progress(self) -> float:
        """The mean return of the law in the latest slice.

        A law that explores may return less than what is known for a while, and yet learn.
        """
        return float(np.mean(self._means)) if self._means else -math.inf

    def state(self) -> State | None:
        """The learner and its phase, by seconds since the race began."""
        learner, phase = self._learner, self._phase
        if learner is None or phase is None:
            return self._resumed
        leaves = enumerate(jax.tree.leaves(learner))
        tensors = {f"{_LEARNER}/{number}": np.asarray(leaf) for number, leaf in leaves}
        began = self._arena.began
        values = {
            "phases": self._phases,
            "began": phase.began - began,
            "ends": phase.ends - began,
            "factor": phase.factor,
        }
        return State(tensors, values)

    def restore(self, state: State) -> None:
        """Keeps it until the program is compiled."""
        count_of(state.values["phases"])  # raises if there is none
        self._resumed = state

    def _begin(self) -> None:
        self._start(self._compile)

    def _compile(self) -> None:
        """Makes the law, and learns nothing from the first rollouts."""
        self._gradient = PolicyGradient(self._arena.planner)
        learner = self._gradient.begin(self._arena.noop, self._phase_key)
        jax.block_until_ready(self._gradient.iterate(learner, self._trial_key, _STILL))
        if self._resumed is not None:
            self._try(lambda state: self._go_on(learner, state), self._resumed)

    def _go_on(self, like: Learner, state: State) -> None:
        """Restores the learner, whose leaves are like another one's, and its phase."""
        leaves, tree = jax.tree.flatten(like)
        found = [
            jnp.asarray(state.array(f"{_LEARNER}/{number}", np.shape(leaf)), leaf.dtype)
            for number, leaf in enumerate(leaves)
        ]
        values, race = state.values, self._arena.began
        began, ends, factor = (float(values[name]) for name in ("began", "ends", "factor"))
        phases, seconds = count_of(values["phases"]), self._arena.deadline - race
        # the clocks of two processes round differently
        if not (0.0 <= began <= ends <= seconds + 1.0 and 0.0 < factor <= 1.0):
            raise ValueError(f"its phase is from {began} to {ends} s, its step {factor}")
        if not 1 <= phases <= _MOST_PHASES:
            raise ValueError(f"it has {phases} phases")
        self._phase = _Phase(None, race + began, race + ends, factor)
        self._learner = jax.tree.unflatten(tree, found)
        # it was stopped in the middle of a phase, which goes on
        self._phases, self._is_better = phases, True

    def _work(self, until: float) -> None:
        """Goes on learning.

        Raises:
          Cancelled: if interrupted; what was learnt till then is offered.
        """
        if not self._is_compiled(until):
            return
        if not self._goes_on():
            self._begin_phase(until)
        self._is_better = False
        try:
            self._learn(until)
        except (KeyboardInterrupt, Cancelled):
            self._offer_learnt()
            raise
        self._offer_learnt()

    def judged(self, candidate: Candidate) -> None:
        """Is told what the judge says, and whether it is the best so far."""
        super().judged(candidate)
        self._is_better = candidate is self._arena.judge.incumbent

    def _goes_on(self) -> bool:
        """Whether the phase has more to find."""
        if self._phase is None or self._has_collapsed:
            return False
        is_in_time = self._clock() < self._phase.ends
        return is_in_time and (self._phases == 1 or self._is_better)

    def _learn(self, until: float) -> None:
        assert self._phase is not None
        assert self._learner is not None
        self._means = []
        while True:
            self._arena.pulse()
            started = self._clock()
            key = jax.random.fold_in(self._iteration_key, self._log.iterations)
            pace = self._phase.pace(started)
            self._learner, shown = self._gradient.iterate(self._learner, key, pace)
            self._log.iterations += 1
            is_lost = not (bool(shown.is_finite) and math.isfinite(shown.mean_return))
            self._iteration_seconds = self._clock() - started
            if is_lost and self._is_given_up():
                break
            if not is_lost:
                self._lost = 0
                self._means.append(float(shown.mean_return))
                self._has_collapsed = float(shown.entropy) < _NO_ENTROPY
            if self._has_collapsed or self._clock() + self._iteration_seconds > until:
                break

    def _is_given_up(self) -> bool:
        """Counts an iteration from which nothing was learnt."""
        self._lost += 1
        count = self._log.details.get("not_finite", 0) + 1
        self._log.details = {**self._log.details, "not_finite": count}
        if self._lost < _MOST_LOST:
            return False
        cause = "returns of its rollouts, or what is learnt from them, are not finite"
        self._log.details = {**self._log.details, "cause": cause}
        self.is_exhausted = True
        return True

    def _begin_phase(self, until: float) -> None:
        arena, now = self._arena, self._clock()
        is_first = not self._phases
        parent = None if is_first else arena.incumbent
        if parent is not None and _has_plan(parent.params):
            parent = None
        best = self._earlier_params(arena.planner) if parent is None else parent.params
        ends_by = now + _SCALING_SHARE * (until - now)
        params = arena.noop if best is None else self._exploring(best, ends_by)
        # its program may have taken longer than that to compile
        late = max(self._first_until, arena.until(_LEAST_SHARE))
        ends = late if is_first else arena.deadline
        factor = 1.0 if best is None else _LATER
        if self._phases > 1 and self._phase is not None and not self._is_better:
            factor = _SMALLER * self._phase.factor
        self._has_collapsed = False
        self._phase = _Phase(parent, now, ends, factor)
        self._phases += 1
        key = jax.random.fold_in(self._phase_key, self._phases)
        self._learner = self._gradient.begin(params, key)

    def _exploring(self, params: Params, until: float) -> Params:
        """A policy with the same likeliest actions, whose law explores; looked for till then."""
        low, high = math.log(_SMALLEST_SCALE), 0.0
        for _ in range(_BISECTIONS):
            if self._clock() + self._iteration_seconds > until:
                break
            middle, key = 0.5 * (low + high), self._trial_key
            learner = self._gradient.begin(with_raw_scale(params, math.exp(middle)), key)
            _, shown = self._gradient.iterate(learner, key, _STILL)
            explores = float(shown.entropy) > _EXPLORING_ENTROPY
            low, high = (middle, high) if explores else (low, middle)
        return with_raw_scale(params, math.exp(0.5 * (low + high)))

    def _offer_learnt(self) -> None:
        assert self._phase is not None
        assert self._learner is not None
        params = jax.tree.map(np.asarray, self._learner.params)
        self._offer_child(self._phase.parent, f"ppo, phase {self._phases}", params)


def _has_plan(params: Params) -> bool:
    return any(np.any(leaf) for leaf in jax.tree.leaves(params.get("plan", {})))
