"""The arm that adapts each object's own weights beside the shared ones, without a gradient."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdpo_rddl.auto.arena.adapting import Adapting
from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.object_wise import FEWEST_OBJECTS, ObjectWise, objects_of
from mdpo_rddl.auto.search.weights import Weights, flat_vector, weights_of
from mdpo_rddl.errors import Cancelled, note_heard

OWN_WEIGHTS = "own weights"
_SIGMA = 0.03
_MOST_OWN_WEIGHTS = 5000
# one object's weights are changed at a time where so many rounds fit into a slice; the weights are
# near their best then, and the first deviations smaller
_FEWEST_ROUNDS, _SIGMA_AFTER = 3, 0.01


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
      start: likewise, with which the slice began.
      has_missed: whether it went on although it had led to a policy that was not the best.
    """

    adaptation: Adaptation
    first: int
    led_to: np.ndarray
    start: np.ndarray
    has_missed: bool = False


class OwnWeightsArm(ArenaArm):
    """Adapts shared and own weights around a policy; of too many, the shared ones only.

    As long as each slice begins with the policy that the one before it has found, one adaptation
    goes on: what it has learnt of deviations is worth many iterations. At first it loses, so that
    it goes on once where that policy was not the best.
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
        self._adapting = Adapting(arena)
        # where the slice's adaptation begins
        self._begun = np.zeros(0)
        self._latest: _Latest | None = None

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
        start, self._begun = flat_vector(parent.params), weights.start
        try:
            latest = self._adaptation(start, weights, until)
            adaptation = latest.adaptation
            self._log.iterations += self._adapting.run(weights, adaptation, until, latest.first)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            adapted = self._adapting.found
            found = self._begun if adapted is None else adapted
            if found is not weights.start:
                self._offer_child(parent, around.label, weights.to_params(found))
            raise
        found = adaptation.mean
        self._latest = latest._replace(led_to=flat_vector(weights.to_params(found)))
        if self._begun is not weights.start and adaptation.iterations:
            # an adaptation loses at first
            found = arena.population.best(weights, [found, self._begun])
        self._offer_child(parent, around.label, weights.to_params(found))

    def _adaptation(self, start: np.ndarray, weights: Weights, until: float) -> _Latest:
        """The latest one if it goes on in a slice that begins so, else one of its own."""
        latest = self._latest
        if latest is not None and np.array_equal(start, latest.led_to):
            return latest._replace(start=start, has_missed=False)
        if latest is not None and not latest.has_missed and np.array_equal(start, latest.start):
            return latest._replace(has_missed=True)
        # with samples and rollouts of its own; the generator refuses the seed 0
        seed, sigma = self._arena.seed + max(1, self._log.slices), self._around.sigma
        self._change_objects(weights, seed, until)
        if self._begun is not weights.start:
            sigma = min(sigma, _SIGMA_AFTER)
        count = self._arena.population.population
        sampling = Sampling(sigma, count, seed, separable=True)
        adaptation = Adaptation(self._begun, sampling, self._clock)
        return _Latest(adaptation, self._log.iterations, start, start)

    def _change_objects(self, weights: Weights, seed: int, until: float) -> None:
        """Searches for one object's weights at a time, if there are several, and time for it."""
        population = self._arena.population
        objects = objects_of(self._arena.planner.rddl, weights.to_params(weights.start))
        # where there are too many own weights only the shared ones vary
        if objects.size != weights.start.size or np.max(objects) + 1 < FEWEST_OBJECTS:
            return
        search = ObjectWise(weights.start, objects, population.population, seed)
        needed = _FEWEST_ROUNDS * search.round_populations * population.seconds
        if self._clock() + needed > until:
            return
        evaluate = self._adapting.evaluation(weights, self._log.iterations)
        try:
            search.run(evaluate, lambda: self._clock() < until)
        finally:
            self._log.iterations += search.iterations
            if search.gained:
                self._begun = search.best
