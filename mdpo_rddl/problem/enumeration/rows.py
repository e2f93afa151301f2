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


_Flip = tuple[int, np.ndarray]
"""A word of afterstates, and the bits in it [N] that differ from another's."""


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
        actions, default = self._model.actions, self._default(batch)
        is_default_legal = batch.of(actions[0].legal).astype(bool)
        default_reward = batch.of(actions[0].reward)
        flips: dict[Any, _Flip | None] = {}
        allowed, found = np.zeros(len(states), bool), []
        for number, action in enumerate(actions):
            legal = batch.of(action.legal).astype(bool)
            allowed |= legal
            changes = self._changes(number, default, batch, flips)
            reward = batch.of(action.reward) * 1.0
            if number:
                # what is no number is told below
                is_worth_it = ~(reward <= default_reward) | ~is_default_legal
                for _, flip in changes:
                    is_worth_it |= flip != 0
                legal = legal & is_worth_it
            chosen = np.flatnonzero(legal)
            if not len(chosen):
                continue
            if not np.isfinite(reward[chosen]).all():
                raise NotEnumerableError("a reward that is not finite")
            packed = default[chosen]
            for word, flip in changes:
                packed[:, word] ^= flip[chosen]
            found.append((chosen, np.full(len(chosen), number), reward[chosen], packed))
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

    def _changes(
        self, action: int, default: np.ndarray, batch: _Batch, flips: dict[Any, _Flip | None]
    ) -> list[_Flip]:
        """How an action's afterstates differ from the default action's [N, words].

        Args:
          action: its number.
          default: afterstates of the default action.
          batch: the values of all nodes.
          flips: of what several actions share, None for what differs nowhere; extended.
        """
        rules, afterstates = self._model.actions[action], self._afterstates
        found = []

        def compare(number: int, law: Any, encode: Callable[[], np.ndarray]) -> None:
            if (number, law) not in flips:
                place = afterstates.packing.places[number]
                flip = (default[:, place.word] & place.mask) ^ encode()
                flips[number, law] = (place.word, flip) if flip.any() else None
            if (change := flips[number, law]) is not None:
                found.append(change)

        for number in self._differs[action]:
            law = rules.laws[number]
            compare(number, law, partial(afterstates.encode, number, law, batch.of))
        for group in self._differing_groups[action]:
            joint, first = rules.joint[group], self._model.groups[group][0]
            compare(first, joint, partial(afterstates.encode_group, joint, batch.of, group))
        return found
