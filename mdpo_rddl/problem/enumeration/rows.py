"""What may be done in each of many states: legal actions, rewards and afterstates."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.problem.enumeration.afterstates import Afterstates
from mdpo_rddl.problem.enumeration.limits import NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.program import Program


class Rows(NamedTuple):
    """States with an action that is worth considering there, sorted by state.

    Attributes:
      state: of each row, which of the N states [R].
      action: of each row, its number in the model [R].
      reward: expected reward of each row [R].
      afterstates: of each row, packed [R, words].
    """

    state: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    afterstates: np.ndarray


NO_ROWS = Rows(np.zeros(0, int), np.zeros(0, np.int32), np.zeros(0), np.zeros((0, 1), np.uint64))
"""Of no states."""


class _Batch:
    """Values of the nodes in N states."""

    def __init__(self, values: dict[int, Any], count: int) -> None:
        self._values, self.count = values, count

    def of(self, node: int) -> np.ndarray:
        value = self._values[node]
        # what is broadcast already is so most often, and asking takes as long as many operations
        if isinstance(value, np.ndarray) and value.shape == (self.count,):
            return value
        return np.broadcast_to(value, self.count)


class RowMaker:
    """Evaluates a model's rules for many states at a time."""

    def __init__(self, model: GroundModel, afterstates: Afterstates) -> None:
        """Orders the evaluation."""
        self._model, self._afterstates = model, afterstates
        outputs = {node for action in model.actions for node in action.nodes()}
        self._program = Program(model.graph, outputs)
        self._ends = Program(model.graph, [model.ends])
        default = model.actions[0]
        self._alone = Program(model.graph, default.nodes())
        self._differs = [
            [number for number, law in enumerate(action.laws) if law != default.laws[number]]
            for action in model.actions
        ]
        self._differing_groups = [
            [group for group, law in enumerate(action.joint) if law != default.joint[group]]
            for action in model.actions
        ]

    @property
    def operations(self) -> int:
        """Number of operations on each state."""
        return self._program.size

    def ended(self, states: np.ndarray) -> np.ndarray:
        """Whether the episode has ended in states [N, words]."""
        values = self._ends.run(self._columns(states))
        return np.broadcast_to(values[self._model.ends], len(states))

    def rows(self, states: np.ndarray) -> Rows:
        """The rows of states [N, words] in which the episode goes on.

        An action that does in a state what the default action does, and gives no more reward,
        is left out.

        Raises:
          NotEnumerableError: if a state has no legal action, or a reward is not finite.
        """
        batch = _Batch(self._program.run(self._columns(states)), len(states))
        actions = self._model.actions
        is_default_legal = batch.of(actions[0].legal).astype(bool)
        unchanged = self._default(batch)
        flips: dict[Any, np.ndarray] = {}
        allowed, found = np.zeros(len(states), bool), []
        for number, action in enumerate(actions):
            legal = batch.of(action.legal).astype(bool)
            allowed |= legal
            packed = self._changed(number, unchanged, batch, flips)
            reward = batch.of(action.reward) * 1.0
            if number:
                is_same = np.all(packed == unchanged, axis=1)
                is_same &= reward <= batch.of(actions[0].reward)
                legal = legal & ~(is_same & is_default_legal)
            chosen = np.flatnonzero(legal)
            if not np.isfinite(reward[chosen]).all():
                raise NotEnumerableError("a reward that is not finite")
            found.append((chosen, np.full(len(chosen), number), reward[chosen], packed[chosen]))
        if not allowed.all():
            raise NotEnumerableError("a reachable state without a legal action")
        state, played, reward, packed = map(np.concatenate, zip(*found, strict=True))
        order = np.argsort(state, kind="stable")
        return Rows(state[order], played[order].astype(np.int32), reward[order], packed[order])

    def first(self, states: np.ndarray) -> Rows:
        """Of each state [N, words] in which the episode goes on the first row alone.

        That is the default action's, which takes far less time than all do, where it is legal.

        Raises:
          NotEnumerableError: as `rows`.
        """
        default = self._model.actions[0]
        batch = _Batch(self._alone.run(self._columns(states)), len(states))
        reward = batch.of(default.reward) * 1.0
        if not (np.all(batch.of(default.legal)) and np.isfinite(reward).all()):
            made = self.rows(states)
            place = np.searchsorted(made.state, np.arange(len(states)))
            return Rows(*(column[place] for column in made))
        number, action = np.arange(len(states)), np.zeros(len(states), np.int32)
        return Rows(number, action, reward, self._default(batch))

    def _columns(self, states: np.ndarray) -> dict[int, np.ndarray]:
        model = self._model
        return {
            model.leaf(number): model.packing.decode(number, states)
            for number in range(len(model.variables))
        }

    def _default(self, batch: _Batch) -> np.ndarray:
        """Afterstates [N, words] of the default action."""
        packing = self._afterstates.packing
        packed = np.zeros((batch.count, packing.words), np.uint64)
        default = self._model.actions[0]
        for number, law in enumerate(default.laws):
            if law:
                word = packing.places[number].word
                packed[:, word] |= self._afterstates.encode(number, law, batch.of)
        for group, joint in enumerate(default.joint):
            word = packing.places[self._model.groups[group][0]].word
            packed[:, word] |= self._afterstates.encode_group(joint, batch.of, group)
        return packed

    def _changed(
        self, action: int, unchanged: np.ndarray, batch: _Batch, flips: dict[Any, np.ndarray]
    ) -> np.ndarray:
        """Afterstates [N, words] of another action; `flips` keeps what several share."""
        packed, rules = unchanged.copy(), self._model.actions[action]

        def put(number: int, key: Any, encode: Callable[[], np.ndarray]) -> None:
            place = self._afterstates.packing.places[number]
            if key not in flips:
                flips[key] = (unchanged[:, place.word] & place.mask) ^ encode()
            packed[:, place.word] ^= flips[key]

        for number in self._differs[action]:
            law = rules.laws[number]
            encode = partial(self._afterstates.encode, number, law, batch.of)
            put(number, (number, law), encode)
        for group in self._differing_groups[action]:
            joint, first = rules.joint[group], self._model.groups[group][0]
            together = partial(self._afterstates.encode_group, joint, batch.of, group)
            put(first, (first, joint), together)
        return packed
