"""Constant actions on the exact model: what they return, where they lead, and whether chance shows.

They are played in batches of one size, for one program, that are small enough for the memory.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import jax
import numpy as np

from mdpo_rddl.auto.common.compilations import compiled_within
from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.sizes import VISITS_BYTES, Batches
from mdpo_rddl.auto.common.timing import Clock, made_once
from mdpo_rddl.planner.exact.exact import Visits, compile_visits, visit_bytes
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.programs.quick import quick_jit, quick_share

# what its program takes to compile, in terms of one that is not of the quick kind
_QUICK_PROBING_SHARE = 0.75

Constant = Mapping[str, np.ndarray]
"""A raw action per action fluent [*shape], the same at every step."""


class Constants:
    """Plays constants until it is late.

    Attributes:
      planner: whose policies they are.
      size: of the batches.
      seconds: that the latest batch took.
      are_alike: whether all rollouts of each constant had the same return.
      saw_alike: whether they saw the same states, too.
      is_without_chance: whether all returns of each were the same, and no part of a state that
        the constants change differed between the rollouts of one.
    """

    def __init__(
        self,
        planner: MDPOPlanner,
        seed: int,
        size: Batches,
        until: float,
        clock: Clock,
        deadline: float = math.inf,
    ) -> None:
        """Compiles nothing yet.

        Args:
          planner: with a `FeedbackPlan`.
          seed: of the model.
          size: of the batches.
          until: when to end, by the clock; the first batch, which compiles, is not counted.
          clock: what is asked for the time.
          deadline: when to end at the latest, compiled or not.
        """
        self.planner, self.size = planner, size
        one_by_one = 1 if size.at_once == 1 else None
        # nothing else is there before it, and where it is called often there is too little time
        self._play = made_once(
            lambda: compile_visits(planner, size.rollouts, side_by_side=one_by_one, jit=quick_jit)
        )
        self._deadline = deadline
        self._key = key_for(Draws.PROBING, seed)
        self._params = planner.feedback_plan.noop(seed)
        self._until, self._clock = until, clock
        self._played, self.seconds, self._first_seconds = 0, 0.0, 0.0
        self.are_alike, self.saw_alike = True, True
        self._random: dict[str, np.ndarray] = {}
        self._changed: dict[str, np.ndarray] = {}
        self._first: dict[str, np.ndarray] = {}
        kept = size.constants * size.rollouts * visit_bytes(planner)
        self._stride = max(1, math.ceil(kept / VISITS_BYTES))

    @property
    def is_late(self) -> bool:
        """Whether another batch would end after its time."""
        if not self._played:
            return False
        next_seconds = self.seconds if self._played > 1 else 0.0
        return self._clock() + next_seconds > self._until

    @property
    def batch_seconds(self) -> float:
        """Of the latest batch that did not compile; 0 if none was played."""
        return self.seconds if self._played > 1 else 0.0

    @property
    def compile_seconds(self) -> float:
        """What the first batch took longer than that."""
        return max(0.0, self._first_seconds - self.batch_seconds)

    @property
    def usual_seconds(self) -> float:
        """What a program for the rollouts of policies is likely to take, which is not quick."""
        return self.compile_seconds / (_QUICK_PROBING_SHARE if quick_share() < 1.0 else 1.0)

    @property
    def is_without_chance(self) -> bool:
        """See the class."""
        both = (self._random[name] & self._changed[name] for name in self._random)
        return self.are_alike and not any(map(np.any, both))

    def __call__(self, key: jax.Array, params: Params) -> np.ndarray:
        """Returns [P, N] of any policies, as many as a batch has, once a batch was played."""
        began = self._clock()
        returns = np.asarray(self._play(key, params)[0], float)
        self.seconds = self._clock() - began
        return returns

    def means(self, constants: Sequence[Constant]) -> np.ndarray:
        """Mean returns [C]; minus infinity if not finite, or if it was too late to play one."""
        batches = [means for means, _ in self._batches_of(constants, at_least=0)]
        played = np.concatenate([np.zeros(0), *batches])
        return np.append(played, np.full(len(constants) - len(played), -np.inf))

    def means_and_states(
        self, constants: Sequence[Constant], at_least: int
    ) -> tuple[np.ndarray, dict[str, list[np.ndarray]]]:
        """Plays constants, some of them even if it is late.

        Args:
          constants: to be played, no more than there are in all.
          at_least: how many, of the first ones.

        Returns:
          The mean returns [C] of those that were played, minus infinity if not finite; and per
          observed fluent the values that they saw, in arrays [P, N, steps, *shape] that have some
          of the steps only if all are too many.
        """
        means: list[np.ndarray] = []
        seen: dict[str, list[np.ndarray]] = {}
        for batch_means, states in self._batches_of(constants, at_least):
            means.append(batch_means)
            for name, values in states.items():
                some = values[: len(batch_means), :, :: self._stride]
                seen.setdefault(name, []).append(some.copy())
        return np.concatenate(means), seen

    def _batches_of(
        self, constants: Sequence[Constant], at_least: int
    ) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
        """Mean returns and states of batches, until it is late."""
        for first in range(0, len(constants), self.size.at_once):
            if first >= at_least and self.is_late:
                break
            returns, states = self._batch(constants[first : first + self.size.at_once], self._key)
            for name, values in states.items():
                self._first.setdefault(name, values[0].copy())
            self._note(returns, states, self._first)
            means = np.mean(returns, axis=1)
            yield np.where(np.isfinite(means), means, -np.inf), states

    def confirm(self, constants: Sequence[Constant], batches: int) -> bool:
        """Whether `is_without_chance` holds in other rollouts, too.

        Args:
          constants: the first ones of which are played, as many as a batch has.
          batches: of N rollouts; it is not confirmed if there is no time for all.
        """
        for number in range(1, batches + 1):
            if self.is_late or not self.is_without_chance:
                return False
            key = jax.random.fold_in(self._key, number)
            returns, states = self._batch(constants[: self.size.at_once], key)
            self._note(returns, states, {name: values[0] for name, values in states.items()})
        return self.is_without_chance

    def fresh_returns(self, one: Constant, other: Constant, batches: int) -> np.ndarray:
        """Returns of two constants [2, R] in common rollouts that neither was chosen by.

        Args:
          one: constant.
          other: constant.
          batches: of N rollouts, as long as it is not late; R may be 0.
        """
        found = [np.zeros((2, 0))]
        for number in range(1, batches + 1):
            if self.is_late:
                break
            key = jax.random.fold_in(self._key, number)
            pairs = ([one, other],) if self.size.at_once > 1 else ([one], [other])
            found.append(np.concatenate([self._batch(pair, key)[0] for pair in pairs]))
        return np.concatenate(found, axis=1)

    def _batch(
        self, constants: Sequence[Constant], key: jax.Array
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Returns [P, N] and states [P, N, H, *shape] of constants that fit into a batch.

        Raises:
          TooLateError: if the deadline comes before the first batch was played.
        """
        began = self._clock()
        padded = [*constants, *[constants[0]] * (self.size.at_once - len(constants))]
        policies = [with_bias(self._params, constant) for constant in padded]
        params = jax.tree.map(lambda *each: np.stack(each), *policies)

        def play() -> Visits:
            return jax.block_until_ready(self._play(key, params))

        left = self._deadline - began
        visits = play() if self._played else compiled_within(left, play)
        returns = np.asarray(visits.returns, float)
        states = {name: np.asarray(values) for name, values in visits.states.items()}
        self.seconds = self._clock() - began
        if not self._played:
            self._first_seconds = self.seconds
            self._until = min(self._until + self.seconds, self._deadline)
        self._played += 1
        return returns[: len(constants)], states

    def _note(
        self,
        returns: np.ndarray,
        states: Mapping[str, np.ndarray],
        first: Mapping[str, np.ndarray],
    ) -> None:
        """What differs between the rollouts of one constant, and from what the first one saw."""
        self.are_alike &= bool(np.all(returns == returns[:, :1]))
        for name, values in states.items():
            random = np.any(values != values[:, :1], axis=(0, 1, 2))
            changed = np.any(values != first[name], axis=(0, 1, 2))
            self.saw_alike &= not np.any(random)
            self._random[name] = self._random.get(name, False) | random
            self._changed[name] = self._changed.get(name, False) | changed


def with_bias(params: Params, bias: Constant) -> Params:
    """Parameters whose policy adds a constant to each object's raw action."""
    own = {
        name: {**entries, "bias": np.asarray(bias[name], entries["bias"].dtype)}
        for name, entries in params["own"].items()
    }
    return {**params, "own": own}
