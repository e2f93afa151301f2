"""The arm that adapts each object's own weights beside the shared ones, without a gradient."""

from dataclasses import dataclass

import numpy as np

from mdpo_rddl.auto.adapting import Adapting
from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.weights import flat_vector, weights_of
from mdpo_rddl.auto.state import State, joined
from mdpo_rddl.errors import Cancelled, note_heard

OWN_WEIGHTS = "own weights"
_SIGMA = 0.03
_MOST_OWN_WEIGHTS = 5000


@dataclass(frozen=True)
class Around:
    """Where the weights are adapted.

    Attributes:
      begins_with: label of the candidate to begin with; None for the best one.
      sigma: the first deviation of each weight.
      label: of what is found.
    """

    begins_with: str | None = None
    sigma: float = _SIGMA
    label: str = OWN_WEIGHTS


class OwnWeightsArm(ArenaArm):
    """Adapts shared and own weights around a policy; of too many, the shared ones only."""

    def __init__(self, name: str, arena: Arena, around: Around) -> None:
        """Compiles nothing yet.

        Args:
          name: for people.
          arena: what all arms have in common.
          around: where the weights are adapted.
        """
        super().__init__(name, arena)
        self._around = around
        self._adapting = Adapting(arena, self._try)
        # of the adaptation that goes on
        self._start = np.zeros(0)

    def state(self) -> State | None:
        """The adaptation of the slice that goes on, and the policy that it began with."""
        latest = self._adapting.state()
        if latest is None:
            return None
        return joined(State({"start": self._start}), latest.within("adaptation"))

    def restore(self, state: State) -> None:
        """Goes on with the adaptation if the slice begins where that of another process did."""
        self._start = state.array("start", (None,))
        self._adapting.restore(state.part("adaptation"))

    def _prepare(self) -> None:
        self._arena.compile_population()

    def _work(self, until: float) -> None:
        """Adapts weights around a policy.

        Raises:
          Cancelled: if interrupted; what was found till then is offered.
        """
        arena, population, around = self._arena, self._arena.population, self._around
        parent = None if around.begins_with is None else arena.judge.latest(around.begins_with)
        parent = arena.incumbent if parent is None else parent
        weights = weights_of(parent.params, ["shared", "own"])
        if weights.start.size > _MOST_OWN_WEIGHTS:
            weights = weights_of(parent.params, ["shared"])
        # each slice has samples and rollouts of its own; the generator refuses the seed 0
        seed, before = arena.seed + max(1, self._log.slices), self._log.iterations
        sampling = Sampling(around.sigma, population.population, seed, separable=True)
        adaptation = Adaptation(weights.start, sampling, self._clock)
        start = flat_vector(parent.params)
        if not np.array_equal(start, self._start):
            self._adapting.restore(None)
        self._start = start
        try:
            self._log.iterations += self._adapting.run(weights, adaptation, until, before)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            if adaptation.iterations:
                self._offer_child(parent, around.label, weights.to_params(adaptation.mean))
            raise
        self._offer_child(parent, around.label, weights.to_params(adaptation.mean))
