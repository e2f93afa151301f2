"""The arm that learns a value from exact rollouts, and plays the greedy policy of that."""

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
from mdpo_rddl.auto.fitting import greedy
from mdpo_rddl.auto.judge import mean_and_error
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.policy_iteration.learner import Learner, Learning, PolicyIteration, Shown

GREEDY = "greedy"
# Adam's, of the value; of it, after the first part, and what is left at the end of each
_STEP, _LATER, _LAST_STEP = 3e-3, 0.3, 0.05
# of an iteration; fewer where each decision tries more than so many actions
_ROLLOUTS, _FEW_ROLLOUTS, _MANY_TRIED = 256, 64, 64
# of the race: an iteration that takes longer leaves too few
_LONGEST_SHARE = 0.02
# of a policy that is handed in, at least
_JUDGED_ROLLOUTS = 128


class PolicyIterationArm(LearningArm[Learner]):
    """Fits a value to its greedy policy's rollouts, and offers that policy.

    In the first iteration half of the rollouts are those of the best policy so far of the arena's
    planner, so that the value begins with what that one finds. Adam's step size falls to the end of
    the first part, and again, from a smaller one, to the end of the race.
    """

    def __init__(self, arena: Arena, until: float) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common; all actions are bools, the state is observed.
          until: when the first part ends, by the clock.
        """
        super().__init__(GREEDY, Draws.GREEDY, arena, until)
        self._judged_key = jax.random.fold_in(self._trial_key, 1)
        # arms that the first iteration's guide goes back to
        self._parents: tuple[str, ...] = ()
        # the policy of the slice whose rollouts returned most: weights, and their scale
        self._best: tuple[float, Any, Any] = (-math.inf, None, None)

    def _build(self) -> Learner:
        """Makes the planner too."""
        arena = self._arena
        self._planner = build_planner(arena.problem, greedy(arena.config)).planner
        plan = self._planner.plan
        assert isinstance(plan, GreedyPlan)
        rollouts = _ROLLOUTS if plan.tried <= _MANY_TRIED else _FEW_ROLLOUTS
        self._iteration = PolicyIteration(self._planner, arena.plan, Learning(rollouts=rollouts))
        begun = self._iteration.begin(self._learner_key)
        jax.block_until_ready(self._iterated(begun, self._trial_key, 0.0, is_first=True))
        return begun

    def _values(self) -> dict[str, Any]:
        return {"parents": list(self._parents)}

    def _take(self, values: Mapping[str, Any]) -> None:
        self._parents = tuple(map(str, values["parents"]))

    def _kept(self, learner: Learner) -> tuple[Any, ...]:
        """The value, without the rollouts that it was fitted to."""
        return learner.weights, learner.moments, learner.times, learner.scale

    def _with_kept(self, begun: Learner, kept: tuple[Any, ...]) -> Learner:
        weights, moments, times, scale = kept
        return begun._replace(weights=weights, moments=moments, times=times, scale=scale)

    def _enter(self, until: float) -> None:
        if self._learner is None:
            self._begin_part()
        self._best = (-math.inf, None, None)

    def _begin_part(self) -> None:
        """The first iteration, from the best policy so far."""
        now, guide = self._clock(), self._arena.incumbent
        self._parents = (*guide.parents, guide.arm) if guide.arm else ()
        self._span = Span(now, self._first_ends())
        begun = self._iteration.begin(self._learner_key)
        # the next iteration is timed
        self._learner, _ = jax.block_until_ready(
            self._iterated(begun, self._trial_key, _STEP, is_first=True)
        )
        self._log.iterations += 1

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
        given = guiding, np.float32(pace), np.array(is_first)
        return self._iteration.iterate(learner, key, *given)

    def _note(self, played: Learner, shown: Shown) -> None:
        mean = self._means[-1]
        if mean > self._best[0]:
            self._best = mean, played.weights, played.scale

    def _cause_to_end(self) -> str:
        """As for all, or that iterations take too long."""
        if self._iteration_seconds > _LONGEST_SHARE * (self._arena.deadline - self._arena.began):
            return f"an iteration takes {self._iteration_seconds:.1f} s"
        return super()._cause_to_end()

    def _offer_learnt(self) -> None:
        """Hands in the latest policy, and the one whose rollouts in the slice returned most.

        What they return is told by other rollouts, which are the arm's own, of the exact model as
        the judge's are, and the same for all: what the judge would play them with takes as long
        to compile as the arm's program.
        """
        learner = self._learner
        assert learner is not None
        if not self._means:
            return  # nothing was learnt in this slice
        _, weights, scale = self._best
        for policy in (learner, learner._replace(weights=weights, scale=scale)):
            mean, error = self._returned(policy)
            self._offer(
                Candidate(
                    arm=GREEDY,
                    label=f"{GREEDY}, iteration {self._log.iterations:,}",
                    config=greedy(self._arena.config),
                    planner=self._planner,
                    params=jax.tree.map(np.asarray, self._iteration.policy(policy)),
                    parents=self._parents,
                    mean=mean,
                    error=error,
                )
            )

    def _returned(self, learner: Learner) -> tuple[float, float]:
        """The mean return of a learner's policy, and its standard error."""
        count = math.ceil(_JUDGED_ROLLOUTS / (self._iteration.rollouts // 2))
        keys = jax.random.split(self._judged_key, count)
        shown = [self._iterated(learner, key, 0.0)[1].returns for key in keys]
        return mean_and_error(np.concatenate(shown))
