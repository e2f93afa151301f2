"""What an arm is that learns from exact rollouts, iteration by iteration."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.draws import Draws, key_for
from mdpo_rddl.auto.state import State
from mdpo_rddl.errors import Cancelled, note_heard

AnyLearner = TypeVar("AnyLearner")
_LEARNER = "learner"
# of the time left, the least for the first span
_LEAST_SHARE = 0.25
# iterations in a row from which nothing finite is learnt, after which it is given up
_MOST_LOST = 10


class Span(NamedTuple):
    """A part of the race, in which the step size falls.

    Attributes:
      began, ends: by the clock.
    """

    began: float
    ends: float

    def share(self, now: float) -> float:
        """How much of it is over, at most 1."""
        return min(1.0, (now - self.began) / max(self.ends - self.began, 1e-9))


class Shown(Protocol):
    """What an iteration has shown."""

    @property
    def mean_return(self) -> Array:
        """Of the rollouts of the policy before it."""

    @property
    def is_finite(self) -> Array:
        """Whether all that was learnt is; else the learner is what it was."""


class LearningArm(CompilingArm, Generic[AnyLearner]):
    """An arm with a learner, which every iteration replaces by the next one.

    A slice goes on learning and hands in what was learnt, also if it is interrupted. An iteration
    whose returns are not finite, or what is learnt from them, counts as lost.
    """

    def __init__(self, name: str, draws: Draws, arena: Arena, until: float) -> None:
        """Compiles nothing yet.

        Args:
          name: for people.
          draws: which random numbers are the arm's.
          arena: what all arms have in common; all actions are bools, the state is observed.
          until: when the first span ends, by the clock.
        """
        super().__init__(name, arena)
        keys = jax.random.split(key_for(draws, arena.seed), 3)
        self._learner_key, self._iteration_key, self._trial_key = keys
        self._first_until = until
        self._span = Span(0.0, 0.0)
        self._learner: AnyLearner | None = None
        # of the slice's iterations
        self._means: list[float] = []
        self._lost = 0
        self._iteration_seconds = 0.0
        # what another process has left, until it is known to fit
        self._resumed: State | None = None

    @property
    def progress(self) -> float:
        """The mean return of what was played in the latest slice's iterations.

        What explores may return less than what is known for a while, and yet learn.
        """
        return float(np.mean(self._means)) if self._means else -math.inf

    def state(self) -> State | None:
        """What is kept of the learner, and its span, by seconds since the race began."""
        if self._learner is None:
            return self._resumed
        leaves = enumerate(jax.tree.leaves(self._kept(self._learner)))
        tensors = {f"{_LEARNER}/{number}": np.asarray(leaf) for number, leaf in leaves}
        began, ends = (each - self._arena.began for each in self._span)
        return State(tensors, {"began": began, "ends": ends, **self._values()})

    def restore(self, state: State) -> None:
        """Keeps it until the program is compiled."""
        self._span_of(state.values)  # raises if there is none
        self._resumed = state

    def _begin(self) -> None:
        self._start(self._compile)

    def _compile(self) -> None:
        begun = self._build()
        if self._resumed is not None:
            self._try(lambda state: self._go_on(begun, state), self._resumed)

    def _go_on(self, begun: AnyLearner, state: State) -> None:
        """Restores the learner, of which is kept what is kept of another one, and its span."""
        leaves, tree = jax.tree.flatten(self._kept(begun))
        found = [
            jnp.asarray(state.array(f"{_LEARNER}/{number}", np.shape(leaf)), leaf.dtype)
            for number, leaf in enumerate(leaves)
        ]
        span = self._span_of(state.values)
        self._take(state.values)
        self._span = span
        self._learner = self._with_kept(begun, jax.tree.unflatten(tree, found))

    def _span_of(self, values: Mapping[str, Any]) -> Span:
        race, seconds = self._arena.began, self._arena.deadline - self._arena.began
        began, ends = float(values["began"]), float(values["ends"])
        # the clocks of two processes round differently
        if not 0.0 <= began <= ends <= seconds + 1.0:
            raise ValueError(f"it learns from {began} to {ends} s of {seconds}")
        return Span(race + began, race + ends)

    def _first_ends(self) -> float:
        """When the first span ends: its program may have taken longer than that to compile."""
        return max(self._first_until, self._arena.until(_LEAST_SHARE))

    def _work(self, until: float) -> None:
        """Goes on learning.

        Raises:
          Cancelled: if interrupted; what was learnt till then is offered.
        """
        if not self._is_compiled(until):
            return
        self._enter(until)
        try:
            self._learn(until)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            self._offer_learnt()
            raise
        self._offer_learnt()

    def _learn(self, until: float) -> None:
        self._means = []
        while True:
            self._learn_once()
            if self.is_exhausted or self._is_settled:
                break
            if self._clock() + self._iteration_seconds > until:
                break

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
            self._note(played, shown)

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
        if self._lost < _MOST_LOST:
            return ""
        return "returns of its rollouts, or what is learnt from them, are not finite"

    @property
    def _is_settled(self) -> bool:
        """Whether the slice has no more to learn, whatever time is left."""
        return False

    @abstractmethod
    def _build(self) -> AnyLearner:
        """Compiles what learns.

        Returns:
          One that has learnt nothing, not from the first rollouts either.
        """

    @abstractmethod
    def _enter(self, until: float) -> None:
        """Begins a slice, at the latest now with a learner and its span."""

    @abstractmethod
    def _pace(self, now: float) -> Any:
        """How far an iteration goes now."""

    @abstractmethod
    def _iterated(self, learner: AnyLearner, key: Array, pace: Any) -> tuple[AnyLearner, Shown]:
        """The next learner, and what the policy before it has shown."""

    @abstractmethod
    def _note(self, played: AnyLearner, shown: Any) -> None:
        """Is told of an iteration that was not lost: its learner before, and what that showed."""

    @abstractmethod
    def _offer_learnt(self) -> None:
        """Hands in what was learnt in the slice."""

    @abstractmethod
    def _values(self) -> dict[str, Any]:
        """What `state` has beside the learner and its span, as JSON can hold it."""

    @abstractmethod
    def _take(self, values: Mapping[str, Any]) -> None:
        """Takes back what `_values` has said; as `restore`, raises where it does not fit."""

    def _kept(self, learner: AnyLearner) -> Any:
        """What another process needs of a learner: a tree of arrays."""
        return learner

    def _with_kept(self, begun: AnyLearner, kept: Any) -> AnyLearner:
        """The learner of which that was kept; the rest as in one that has begun."""
        del begun
        found: AnyLearner = kept
        return found
