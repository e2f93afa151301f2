"""The arm that learns a value from exact rollouts, and plays the greedy policy of that."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import ROLLOUTS
from mdpo_rddl.auto.arena.learning_size import is_too_long, learning_rollouts, least_seconds
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.span import Span
from mdpo_rddl.auto.probing.fitting import greedy
from mdpo_rddl.errors import Cancelled, note_heard
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.policy_iteration.learner import (
    Learner,
    Learning,
    PolicyIteration,
    Shown,
    Way,
)
from mdpo_rddl.planner.programs.quick import Jit, light_jit
from mdpo_rddl.problem.evaluation import mean_and_error

GREEDY = "greedy"
# what a policy is made of
_POLICY = ("weights", "times", "scale")
# Adam's, of the value; of it, after the first part, and what is left at the end of each
_STEP, _LATER, _LAST_STEP = 3e-3, 0.3, 0.05
# errors by which the rollouts of an earlier policy of the slice must have returned more
_ERRORS = 2.0
# of the time left, the least for the first part
_LEAST_SHARE = 0.25
# iterations in a row from which nothing finite is learnt, after which it is given up
_MOST_LOST = 10


class _Best(NamedTuple):
    """The policy of a slice whose rollouts have returned most.

    Attributes:
      mean: what they have returned.
      iteration: after which it was.
      kept: of the learner, what its policy is made of.
    """

    mean: float
    iteration: int
    kept: Mapping[str, Any]


class PolicyIterationArm(CompilingArm):
    """Fits a value to its greedy policy's rollouts, and offers that policy.

    In the first iteration half of the rollouts are those of the best policy so far of the arena's
    planner, so that the value begins with what that one finds. Adam's step size falls to the end of
    the first part, and again, from a smaller one, to the end of the race. A slice goes on learning
    and hands in what was learnt, also if it is interrupted. An iteration whose returns are not
    finite, or what is learnt from them, counts as lost.

    """

    def __init__(
        self,
        arena: Arena,
        until: float,
        usual_seconds: float = 0.0,
        jit: Jit = light_jit,
        batch_seconds: float = 0.0,
    ) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common; all actions have few values, the state is observed.
          until: when the first part ends, by the clock.
          usual_seconds: what its program is likely to take to compile.
          jit: compiles it.
          batch_seconds: that as many rollouts take as the judge has of a candidate; 0 if unknown.
        """
        super().__init__(GREEDY, arena, usual_seconds)
        self._jit, self._batch_seconds = jit, batch_seconds
        keys = jax.random.split(key_for(Draws.GREEDY, arena.seed))
        self._iteration_key, self._trial_key = keys
        self._judged_key = jax.random.fold_in(self._trial_key, 1)
        self._first_until, self._span = until, Span(0.0, 0.0)
        self._learner: Learner | None = None
        # of the slice's iterations
        self._means: list[float] = []
        self._lost, self._iteration_seconds = 0, 0.0
        # of the rollouts of a policy that is handed in
        self._judging_seconds = 0.0
        # arms that the first iteration's guide goes back to
        self._parents: tuple[str, ...] = ()
        self._best: _Best | None = None

    @property
    def progress(self) -> float:
        """The mean return of what was played in the latest slice's iterations.

        What explores may return less than what is known for a while, and yet learn.
        """
        return float(np.mean(self._means)) if self._means else -math.inf

    def _begin(self) -> None:
        self._start(self._compile)

    def _compile(self) -> None:
        """Compiles what learns.

        Raises:
          TooLateError: if an iteration of it takes too long, as is known before it is compiled.
        """
        arena = self._arena
        self._planner = build_planner(arena.problem, greedy(arena.config)).planner
        plan = self._planner.plan
        assert isinstance(plan, GreedyPlan)
        least = least_seconds(plan, self._batch_seconds)
        if is_too_long(least, self._arena.seconds):
            raise TooLateError(f"an iteration would take {least:.1f} s at least")
        learning = Learning(rollouts=learning_rollouts(plan))
        self._iteration = PolicyIteration(self._planner, arena.plan, learning, self._jit)
        trial = self._iterated(self._begun(), self._trial_key, 0.0, is_first=True)
        jax.block_until_ready(trial)

    def _begun(self) -> Learner:
        """The learner before the first iteration, the same each time."""
        return self._iteration.begin(np.random.default_rng([self._arena.seed, Draws.GREEDY]))

    def _work(self, until: float) -> None:
        """Goes on learning.

        Raises:
          Cancelled: if interrupted; what was learnt till then is offered.
        """
        if not self._is_compiled(until):
            return
        if self._learner is None:
            self._begin_part()
        self._best = None
        if self.is_exhausted:
            return  # an iteration takes too long
        try:
            self._learn(until)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            self._offer_learnt()
            raise
        self._offer_learnt()

    def _begin_part(self) -> None:
        """The first iteration, from the best policy so far."""
        now, guide = self._clock(), self._arena.incumbent
        self._parents = (*guide.parents, guide.arm) if guide.arm else ()
        # its program may have taken longer than the first part was to last
        self._span = Span(now, max(self._first_until, self._arena.until(_LEAST_SHARE)))
        begun = self._begun()
        first = self._iterated(begun, self._trial_key, _STEP, is_first=True)
        self._learner, shown = jax.block_until_ready(first)
        self._log.iterations += 1
        # it makes more updates than others
        self._iteration_seconds = (self._clock() - now) / Learning.first_updates
        self._count(is_lost=False)
        self._arena.judge.correct(guide, np.asarray(shown.of_policy))

    def _learn(self, until: float) -> None:
        self._means = []
        while True:
            self._learn_once()
            if self.is_exhausted or self._clock() + self._ending_seconds > until:
                break

    @property
    def _ending_seconds(self) -> float:
        """Of another iteration, and the rollouts of two policies that are handed in after it."""
        judging = self._judging_seconds or self._judged_calls * self._iteration_seconds
        return self._iteration_seconds + 2.0 * judging

    @property
    def _judged_calls(self) -> int:
        return math.ceil(ROLLOUTS / self._iteration.rollouts)

    def _learn_once(self) -> None:
        """One iteration, after which the arm may be exhausted."""
        self._arena.pulse()
        started, played = self._clock(), self._learner
        assert played is not None
        key = jax.random.fold_in(self._iteration_key, self._log.iterations)
        self._learner, shown = self._iterated(played, key, self._pace(started))
        self._log.iterations += 1
        mean = float(shown.mean_return)
        is_lost = not (bool(shown.is_finite) and math.isfinite(mean))
        self._iteration_seconds = self._clock() - started
        self._count(is_lost)
        if not is_lost and not self.is_exhausted:
            self._means.append(mean)
            if self._best is None or mean > self._best.mean:
                kept = {name: getattr(played, name) for name in _POLICY}
                self._best = _Best(mean, self._log.iterations - 1, kept)

    def _count(self, is_lost: bool) -> None:
        """Counts lost iterations, and gives the arm up if there is a cause."""
        self._lost = self._lost + 1 if is_lost else 0
        if is_lost:
            count = self._log.details.get("not_finite", 0) + 1
            self._log.details = {**self._log.details, "not_finite": count}
        if cause := self._cause_to_end():
            self._log.details = {**self._log.details, "cause": cause}
            self.is_exhausted = True

    def _cause_to_end(self) -> str:
        """Why the latest iteration is the last of all; empty if it is not."""
        if is_too_long(self._iteration_seconds, self._arena.seconds):
            return f"an iteration takes {self._iteration_seconds:.1f} s"
        if self._lost < _MOST_LOST:
            return ""
        return "returns of its rollouts, or what is learnt from them, are not finite"

    def _pace(self, now: float) -> float:
        """Adam's step size now."""
        span, factor = self._span, 1.0
        if now > span.ends:
            span, factor = Span(span.ends, self._arena.deadline), _LATER
        return factor * _STEP * max(_LAST_STEP, 1.0 - span.share(now))

    def _iterated(
        self, learner: Learner, key: Array, pace: float, is_first: bool = False
    ) -> tuple[Learner, Shown]:
        guiding = self._arena.incumbent.params if is_first else self._arena.noop
        way = Way(np.float32(pace), np.array(is_first))
        return self._iteration.iterate(learner, key, guiding, way)

    def _offer_learnt(self) -> None:
        """Hands in the latest policy, and an earlier one of the slice if that has returned more.

        What they return is told by other rollouts of the arm's own, the same for all: what the
        judge would play them with takes as long to compile as the arm's program.
        """
        learner, best = self._learner, self._best
        assert learner is not None
        if best is None:
            return  # nothing was learnt in this slice
        mean, error = self._offer_policy(learner, self._log.iterations)
        if best.mean > mean + _ERRORS * error:
            self._offer_policy(learner._replace(**best.kept), best.iteration)

    def _offer_policy(self, learner: Learner, iteration: int) -> tuple[float, float]:
        """Hands in a learner's policy; its mean return, and the standard error of that."""
        mean, error = self._returned(learner)
        self._offer(
            Candidate(
                arm=GREEDY,
                label=f"{GREEDY}, iteration {iteration:,}",
                config=greedy(self._arena.config),
                planner=self._planner,
                params=jax.tree.map(np.asarray, self._iteration.policy(learner)),
                parents=self._parents,
                mean=mean,
                error=error,
            )
        )
        return mean, error

    def _returned(self, learner: Learner) -> tuple[float, float]:
        """The mean return of a learner's policy, and its standard error."""
        started = self._clock()
        keys = jax.random.split(self._judged_key, self._judged_calls)
        shown = [self._iterated(learner, key, 0.0)[1].returns for key in keys]
        found = mean_and_error(np.concatenate(shown))
        self._judging_seconds = self._clock() - started
        return found
