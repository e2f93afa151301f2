"""The arm that adapts each object's own weights beside the shared ones, without a gradient."""

from dataclasses import dataclass
from typing import NamedTuple

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


class _Latest(NamedTuple):
    """The adaptation of the latest slice.

    Attributes:
      adaptation: where it is.
      first: number of its first generation, which says what rollouts it meets.
      led_to: the policy that it has led to, as `flat_vector` gives it.
    """

    adaptation: Adaptation
    first: int
    led_to: np.ndarray


class OwnWeightsArm(ArenaArm):
    """Adapts shared and own weights around a policy; of too many, the shared ones only.

    As long as each slice begins with the policy that the one before it has found, one adaptation
    goes on: what it has learnt of deviations is worth many iterations.
    """

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
        # of the slice's adaptation
        self._start = np.zeros(0)
        self._latest: _Latest | None = None

    def state(self) -> State | None:
        """The latest adaptation, and the policy that its slice, or the next one, begins with."""
        start, found, latest = self._start, self._adapting.state(), self._latest
        if found is None and latest is not None:
            start, found = latest.led_to, latest.adaptation.state()
        if found is None:
            return None
        return joined(State({"start": start}), found.within("adaptation"))

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
        arena, around = self._arena, self._around
        parent = None if around.begins_with is None else arena.judge.latest(around.begins_with)
        parent = arena.incumbent if parent is None else parent
        weights = weights_of(parent.params, ["shared", "own"])
        if weights.start.size > _MOST_OWN_WEIGHTS:
            weights = weights_of(parent.params, ["shared"])
        until = arena.after_population_compiles(weights, until)
        start, before = flat_vector(parent.params), self._log.iterations
        if not np.array_equal(start, self._start):
            self._adapting.restore(None)
        self._start = start
        adaptation, first = self._adaptation(start, weights.start, before)
        try:
            self._log.iterations += self._adapting.run(weights, adaptation, until, first)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            if adaptation.iterations:
                self._offer_child(parent, around.label, weights.to_params(adaptation.mean))
            raise
        found = weights.to_params(adaptation.mean)
        self._latest = _Latest(adaptation, first, flat_vector(found))
        self._offer_child(parent, around.label, found)

    def _adaptation(
        self, start: np.ndarray, weights: np.ndarray, before: int
    ) -> tuple[Adaptation, int]:
        """The latest one if the slice begins where that has led, else one of its own."""
        if self._latest is not None and np.array_equal(start, self._latest.led_to):
            return self._latest[:2]
        # with samples and rollouts of its own; the generator refuses the seed 0
        seed = self._arena.seed + max(1, self._log.slices)
        count = self._arena.population.population
        sampling = Sampling(self._around.sigma, count, seed, separable=True)
        return Adaptation(weights, sampling, self._clock), before
