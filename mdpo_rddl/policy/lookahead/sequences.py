"""Changes of the policy's discrete actions at several of the next steps together."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.base import Gain, Situation
from mdpo_rddl.policy.lookahead.components import Components, some

_DEPTH = 12
_ROUNDS = 5
# proposals of a round: in calls, and at most
_CALLS, _MOST_PROPOSALS = 2, 256
_ELITES = 8
# of the first round, at most this share changes one component of the first action alone
_SINGLE_SHARE = 0.5
# changes of a child beyond the first; the step at which one begins, and for how long it lasts
_MORE_CHANGES, _MEAN_START, _MEAN_LENGTH = 0.7, 3.0, 2.0
# how a child comes about: from two parents, a step earlier or later, with a change taken back
_CROSSED, _MOVED, _TAKEN_BACK = 0.3, 0.15, 0.2


@dataclass
class Sequences:
    """Evolutionary search over changes of the policy's actions at the next steps.

    Elites that are kept, crossed and mutated, and shifted to the next step with the plan that is
    followed, are those of rolling horizon evolution (Perez, Samothrakis, Lucas and Rohlfshagen,
    "Rolling horizon evolution versus tree search for navigation in single-player real-time games",
    2013). Where nothing is changed the policy plays, in the state that a scenario has led to. The
    changes themselves do not depend on the scenario, so that nothing is gained by knowing it.

    Where only one component may differ from the no-op, a change replaces the whole action.

    Attributes:
      depth: number of steps k, at least 2.
      rounds: of proposals at a decision.
    """

    name: str = "sequences"
    depth: int = _DEPTH
    rounds: int = _ROUNDS
    climbs: bool = False
    is_for_chance: bool = True
    _components: Components | None = field(default=None, init=False)
    _places: np.ndarray = field(default_factory=lambda: np.zeros(0, int), init=False)
    _noop: np.ndarray = field(default_factory=lambda: np.zeros(0), init=False)
    _base: np.ndarray = field(default_factory=lambda: np.zeros(0), init=False)
    _known: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0)), init=False)
    _elites: list[Gain] = field(default_factory=list, init=False)
    _is_first: bool = field(default=True, init=False)
    _count: int = field(default=0, init=False)

    def applies(self, components: Components) -> bool:
        """Some component has values that can be listed."""
        self._components, self._places = components, np.array(components.discrete, int)
        self._noop = np.zeros(components.size, np.float32)
        self._noop[self._places] = (1.0 + components.noop - components.lowest)[self._places]
        self.reset()
        return bool(components.discrete)

    def reset(self) -> None:
        """No changes are known in a new episode."""
        self._elites = []
        self._known = np.zeros((0, self.depth, self._parts.size), np.float32)

    def resume(self, changes: np.ndarray) -> None:
        """An episode begins with a plan."""
        self.reset()
        plan = changes[np.newaxis, : self.depth].astype(np.float32)
        self._known = plan if np.any(plan) else plan[:0]

    def begin(self, situation: Situation) -> None:
        """Starts with what the decisions before have found."""
        self._base, self._elites, self._is_first = situation.base, [], True
        most = self._parts.most_candidates(self.depth)
        self._count = min(_CALLS * situation.capacity, _MOST_PROPOSALS, most)

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """Candidates [P, k, D]: what is known, single changes, then children of the best."""
        nothing = np.zeros((1, self.depth, self._parts.size), np.float32)
        if self._is_first:
            self._is_first = False
            single = self._single(random)[: int(_SINGLE_SHARE * self._count)]
            proposed, parents = [self._known, single], np.concatenate([nothing, self._known])
        else:
            better = [gain for gain in gains[:_ELITES] if gain.mean > 0.0]
            self._elites = sorted([*self._elites, *better], key=lambda gain: -gain.mean)[:_ELITES]
            found = [self._changes(gain.candidate) for gain in self._elites]
            proposed, parents = [], np.stack(found) if found else nothing
        children = self._children(parents, self._count, random)
        candidates = _distinct(np.concatenate([*proposed, children])[: self._count])
        candidates[:, 0] = self._parts.changed(candidates[:, 0], self._base)
        differs = np.any(candidates[:, 0] != self._base, axis=1)
        return candidates[differs | np.any(candidates[:, 1:], axis=(1, 2))]

    def shift(self, chosen: np.ndarray) -> None:
        """The rest of what was chosen, and of what else was found, is known at the next step."""
        found = [chosen, *(gain.candidate for gain in self._elites)]
        later = np.stack([candidate[1 : self.depth + 1] for candidate in found])
        rest = np.pad(later, ((0, 0), (0, self.depth - later.shape[1]), (0, 0)))
        self._known = _distinct(rest[np.any(rest, axis=(1, 2))])
        # the next decision may have no time to propose anything
        self._elites = []

    @property
    def _parts(self) -> Components:
        assert self._components is not None  # `applies` was asked first
        return self._components

    def _changes(self, candidate: np.ndarray) -> np.ndarray:
        """A candidate [k, D] with the changes of the policy's first action in its first row."""
        changes = candidate[: self.depth].copy()
        changes[0] = self._parts.changes(changes[0], self._base)
        return changes

    def _single(self, random: np.random.Generator) -> np.ndarray:
        """One change of the first action each, in random order [P, k, D]."""
        parts, places = self._parts, some(len(self._places), self._count, random)
        changes = [
            (place, value)
            for place in self._places[places].tolist()
            for value in parts.values[place]
            if value != self._base[place]
        ]
        order = random.permutation(len(changes))[: self._count]
        found = np.zeros((len(order), self.depth, parts.size), np.float32)
        for row, number in zip(found, order, strict=True):
            self._set(row, slice(0, 1), *changes[number])
        return found

    def _set(self, changes: np.ndarray, steps: slice, place: int, value: float) -> None:
        """Gives a component a value at some steps of changes [k, D]."""
        if self._parts.most == 1:
            changes[steps] = self._noop
        changes[steps, place] = 1.0 + value - self._parts.lowest[place]

    def _children(self, parents: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
        """Mutated parents [P, k, D]."""
        parts = self._parts
        chosen = random.integers(len(parents), size=(count, 2))
        children = parents[chosen[:, 0]].copy()
        kinds = random.random((count, 2))
        cuts = random.integers(1, self.depth, size=count)
        numbers = 1 + random.poisson(_MORE_CHANGES, size=count)
        for child, other, kind, cut, number in zip(
            children, parents[chosen[:, 1]], kinds, cuts, numbers, strict=True
        ):
            if kind[0] < _CROSSED:
                child[cut:] = other[cut:]
            elif kind[0] < _CROSSED + _MOVED:
                child[:] = _moved(child, later=bool(kind[1] < 0.5))
                continue
            for _ in range(number):
                start = min(int(random.exponential(_MEAN_START)), self.depth - 1)
                steps = slice(start, start + int(random.geometric(1.0 / _MEAN_LENGTH)))
                if kind[1] < _TAKEN_BACK:
                    child[steps] = 0.0
                    continue
                place = int(self._places[random.integers(len(self._places))])
                values = parts.values[place]
                self._set(child, steps, place, values[random.integers(len(values))])
        return children


def _moved(changes: np.ndarray, later: bool) -> np.ndarray:
    """Changes [k, D] a step later or earlier."""
    if later:
        return np.pad(changes[:-1], ((1, 0), (0, 0)))
    return np.pad(changes[1:], ((0, 1), (0, 0)))


def _distinct(changes: np.ndarray) -> np.ndarray:
    """Changes [P, k, D] without what stands before."""
    first = {each.tobytes(): place for place, each in reversed(list(enumerate(changes)))}
    return changes[sorted(first.values())]
