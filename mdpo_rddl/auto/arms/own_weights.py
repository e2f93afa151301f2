"""The arm that adapts each object's own weights beside the shared ones, without a gradient."""

from dataclasses import dataclass

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.weights import weights_of

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

    def _prepare(self) -> None:
        self._arena.compile_population()

    def _work(self, until: float) -> None:
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
        adaptation.run(lambda number, vectors: population(weights, before + number, vectors), until)
        self._log.iterations += adaptation.iterations
        self._offer_child(parent, around.label, weights.to_params(adaptation.mean))
