"""The actions of a ground model, alone and together: what is legal, and values side by side."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mdpo_rddl.problem.enumeration.model import OpenModel
from mdpo_rddl.problem.enumeration.sampling import GroundSampler

# that are computed at once
MOST_VALUES = 4_000_000
# of the hash of a state
_SEED = 0

Proposal = frozenset[tuple[int, int]]
"""Numbers of action variables with numbers of their other values than the default."""
NOTHING: Proposal = frozenset()


class GroundActions:
    """What can be played in a ground model.

    Attributes:
      model: the ground model, with the action left open.
      sampler: of it.
      noop: values of all action variables of the no-op [A].
      others: of each action variable the other values than the default.
      most: actions that may be played together.
    """

    def __init__(self, model: OpenModel) -> None:
        """Makes the sampler."""
        self.model, self.sampler = model, GroundSampler(model)
        self.noop = np.array([int(default) for default, _ in model.actions.values()], int)
        self.others = [[int(each) for each in others] for _, others in model.actions.values()]
        self.most = int(min(model.most, len(self.noop)))
        generator = np.random.default_rng(_SEED)
        self._hash = generator.integers(1, 2**62, len(model.variables))

    def codes(self, states: np.ndarray) -> np.ndarray:
        """Hashes of states [V, N], of which none that differ are likely to be equal [N]."""
        return np.asarray(self._hash @ states)

    def fits(self, proposal: Proposal) -> bool:
        """Whether each action has one value, and they are no more than are allowed."""
        return len({number for number, _ in proposal}) == len(proposal) <= self.most

    def legal(
        self, states: np.ndarray, proposals: Iterable[tuple[int, Proposal]]
    ) -> list[tuple[int, Proposal]]:
        """Those proposals that are legal in their states, each once.

        Args:
          states: values of all state variables [V, N].
          proposals: with the number of the state that each is for.
        """
        given = list(dict.fromkeys(proposals))
        most, found = max(1, MOST_VALUES // self.sampler.rows), list[tuple[int, Proposal]]()
        for start in range(0, len(given), most):
            part = given[start : start + most]
            places = np.array([place for place, _ in part])
            actions = self.values([proposal for _, proposal in part])
            legal = self.sampler.legal(states[:, places], actions)
            found += [each for each, holds in zip(part, legal, strict=True) if holds]
        return found

    def joint(
        self,
        states: np.ndarray,
        together: Sequence[tuple[int, Sequence[Iterable[tuple[int, int]]]]],
    ) -> list[tuple[int, Proposal]]:
        """Of actions that go together in a state, as many as are legal, in their order.

        Args:
          states: values of all state variables [V, N].
          together: the number of a state, and actions.
        """
        found = [(place, NOTHING) for place, _ in together]
        for number in range(max((len(each) for _, each in together), default=0)):
            longer = {
                which: (place, found[which][1] | frozenset(assignments[number]))
                for which, (place, assignments) in enumerate(together)
                if number < len(assignments)
            }
            longer = {which: pair for which, pair in longer.items() if self.fits(pair[1])}
            legal = set(self.legal(states, longer.values()))
            found = [
                longer[which] if which in longer and longer[which] in legal else pair
                for which, pair in enumerate(found)
            ]
        return found

    def values(self, proposals: Sequence[Proposal]) -> np.ndarray:
        """Values of all action variables [A, N]."""
        actions = np.repeat(self.noop[:, np.newaxis], len(proposals), axis=1)
        for place, proposal in enumerate(proposals):
            for number, value in proposal:
                actions[number, place] = self.others[number][value]
        return actions

    def by_fluent(self, actions: np.ndarray) -> Mapping[str, np.ndarray]:
        """The values of all action variables [A] per fluent, in a row [*]."""
        found: dict[str, list[int]] = {}
        for (name, _), value in zip(self.model.actions, actions, strict=True):
            found.setdefault(name, []).append(int(value))
        return {name: np.array(values) for name, values in found.items()}
