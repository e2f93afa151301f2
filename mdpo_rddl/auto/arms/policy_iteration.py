"""The arm that learns a value from exact rollouts, and plays the greedy policy of that."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.draws import Draws, key_for
from mdpo_rddl.auto.fitting import greedy
from mdpo_rddl.auto.judge import mean_and_error
from mdpo_rddl.auto.state import State, count_of
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.policy_iteration.learner import Learner, Learning, PolicyIteration

GREEDY = "greedy"
_LEARNER = "learner"
# Adam's, of the value; of it, after the first part, and what is left at the end of each
_STEP, _LATER, _LAST_STEP = 3e-3, 0.3, 0.05
# of the time left, the least for the first part
_LEAST_SHARE = 0.25
# of an iteration; fewer where each decision tries more than so many changes
_ROLLOUTS, _FEW_ROLLOUTS, _MANY_CHANGES = 256, 64, 64
# of the race: an iteration that takes longer leaves too few
_LONGEST_SHARE = 0.02
# of a policy that is handed in, at least
_JUDGED_ROLLOUTS = 128
# iterations in a row from which nothing finite is learnt, after which it is given up
_MOST_LOST = 10


class PolicyIterationArm(CompilingArm):
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
        super().__init__(GREEDY, arena)
        keys = jax.random.split(key_for(Draws.GREEDY, arena.seed), 3)
        self._first_key, self._iteration_key, self._trial_key = keys
        self._judged_key = jax.random.fold_in(self._trial_key, 1)
        self._first_until = until
        self._part = (0.0, 0.0)
        self._parents: tuple[str, ...] = ()
        self._learner: Learner | None = None
        self._means: list[float] = []
        # the policy of the slice whose rollouts returned most: weights, and their scale
        self._best: tuple[float, Any, Any] = (-math.inf, None, None)
        self._lost = 0
        self._iteration_seconds = 0.0
        self._resumed: State | None = None

    @property
    def progress(self) -> float:
        """The mean return of the greedy policies of the latest slice."""
        return float(np.mean(self._means)) if self._means else -math.inf

    def state(self) -> State | None:
        """The value, without the rollouts that it was fitted to, and its part."""
        learner = self._learner
        if learner is None:
            return self._resumed
        leaves = enumerate(jax.tree.leaves(_without_rollouts(learner)))
        tensors = {f"{_LEARNER}/{number}": np.asarray(leaf) for number, leaf in leaves}
        began, ends = (each - self._arena.began for each in self._part)
        return State(tensors, {"began": began, "ends": ends, "parents": list(self._parents)})

    def restore(self, state: State) -> None:
        """Keeps it until the program is compiled."""
        count_of(len(state.values["parents"]))  # raises if there are none
        self._resumed = state

    def _begin(self) -> None:
        self._start(self._compile)

    def _compile(self) -> None:
        """Makes the planner, and learns nothing from the first rollouts."""
        arena = self._arena
        self._planner = build_planner(arena.problem, greedy(arena.config)).planner
        changes = sum(np.size(arena.planner.test_compiled.init_values[n]) for n in self._actions)
        rollouts = _ROLLOUTS if changes <= _MANY_CHANGES else _FEW_ROLLOUTS
        self._iteration = PolicyIteration(self._planner, arena.plan, Learning(rollouts=rollouts))
        learner = self._iteration.begin(self._first_key)
        jax.block_until_ready(self._iterated(learner, self._trial_key, 0.0, is_first=True))
        if self._resumed is not None:
            self._try(lambda state: self._go_on(learner, state), self._resumed)

    @property
    def _actions(self) -> list[str]:
        return list(self._arena.planner.rddl.action_fluents)

    def _iterated(self, learner: Learner, key: Any, step: float, is_first: bool = False) -> Any:
        guiding = self._arena.incumbent.params if is_first else self._arena.noop
        given = guiding, np.float32(step), np.array(is_first)
        return self._iteration.iterate(learner, key, *given)

    def _go_on(self, begun: Learner, state: State) -> None:
        """Restores the value, and its part of the race."""
        leaves, tree = jax.tree.flatten(_without_rollouts(begun))
        found = [
            jnp.asarray(state.array(f"{_LEARNER}/{number}", np.shape(leaf)), leaf.dtype)
            for number, leaf in enumerate(leaves)
        ]
        values, race = state.values, self._arena.began
        began, ends = float(values["began"]), float(values["ends"])
        # the clocks of two processes round differently
        if not 0.0 <= began <= ends <= self._arena.deadline - race + 1.0:
            raise ValueError(f"its part is from {began} to {ends} s")
        self._part = race + began, race + ends
        self._parents = tuple(map(str, values["parents"]))
        weights, moments, times, scale = jax.tree.unflatten(tree, found)
        rest = {"weights": weights, "moments": moments, "times": times, "scale": scale}
        self._learner = begun._replace(**rest)

    def _work(self, until: float) -> None:
        """Goes on learning.

        Raises:
          Cancelled: if interrupted; what was learnt till then is offered if the judge can play it.
        """
        if not self._is_compiled(until):
            return
        try:
            if self._learner is None:
                self._begin_part()
            self._learn(until)
        except (KeyboardInterrupt, Cancelled):
            self._offer_learnt()
            raise
        self._offer_learnt()

    def _begin_part(self) -> None:
        """The first iteration, from the best policy so far."""
        arena, now = self._arena, self._clock()
        guide = arena.incumbent
        self._parents = (*guide.parents, guide.arm) if guide.arm else ()
        self._part = now, max(self._first_until, arena.until(_LEAST_SHARE))
        begun = self._iteration.begin(self._first_key)
        self._learner, _ = self._iterated(begun, self._trial_key, _STEP, is_first=True)
        self._log.iterations += 1

    def _learn(self, until: float) -> None:
        assert self._learner is not None
        self._means, self._best = [], (-math.inf, None, None)
        while True:
            self._arena.pulse()
            started, played = self._clock(), self._learner
            key = jax.random.fold_in(self._iteration_key, self._log.iterations)
            self._learner, shown = self._iterated(self._learner, key, self._step(started))
            self._log.iterations += 1
            mean = float(jnp.mean(shown.returns))
            is_lost = not (bool(shown.is_finite) and math.isfinite(mean))
            self._iteration_seconds = self._clock() - started
            if self._is_given_up(is_lost):
                break
            if not is_lost:
                self._means.append(mean)
                if mean > self._best[0]:
                    self._best = mean, played.weights, played.scale
            if self._clock() + self._iteration_seconds > until:
                break

    def _step(self, now: float) -> float:
        """Adam's step size now."""
        (began, ends), factor = self._part, 1.0
        if now > ends:
            began, ends, factor = ends, self._arena.deadline, _LATER
        done = min(1.0, (now - began) / max(ends - began, 1e-9))
        return factor * _STEP * max(_LAST_STEP, 1.0 - done)

    def _is_given_up(self, is_lost: bool) -> bool:
        """Whether iterations take too long, or nothing is learnt from many in a row."""
        self._lost = self._lost + 1 if is_lost else 0
        race, cause = self._arena.deadline - self._arena.began, ""
        if self._iteration_seconds > _LONGEST_SHARE * race:
            cause = f"an iteration takes {self._iteration_seconds:.1f} s"
        elif self._lost >= _MOST_LOST:
            cause = "returns of its rollouts, or what is learnt from them, are not finite"
        if cause:
            self._log.details = {**self._log.details, "cause": cause}
            self.is_exhausted = True
        return bool(cause)

    def _offer_learnt(self) -> None:
        """Hands in the latest policy, and the one whose rollouts in the slice returned most.

        What they return is told by other rollouts, which are the arm's own, of the exact model as
        the judge's are, and the same for all: what the judge would play them with takes as long
        to compile as the arm's program.
        """
        learner = self._learner
        if learner is None or not self._means:
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


def _without_rollouts(learner: Learner) -> tuple[Any, ...]:
    return learner.weights, learner.moments, learner.times, learner.scale
